"""An axis whose encoder, force sensor and drive are on different buses.

Each part is an axis of its own kind that gives some of the three; this one reads them all and
takes each value from the part that has it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated, Any, Literal

import numpy as np
from pydantic import Field, model_validator

from teleop_rt.axis import SAMPLE_TYPE, Sample
from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.supervision import UnsafeWord
from teleop_rt.kernels.jit import bound, kernel
from teleop_rt_drivers.actuators.config import CanActuator
from teleop_rt_drivers.actuators.line_config import DynamixelPart, FeetechPart
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.framed.config import RawCanPart, SerialPart
from teleop_rt_drivers.framed.stream import keep_arrivals

if TYPE_CHECKING:
    from collections.abc import Mapping

    from teleop_rt.axis import Axis, StoredSample

Part = CanopenPart | SerialPart | RawCanPart | CanActuator | DynamixelPart | FeetechPart


def gives(part: Part) -> set[str]:
    """Return which of position, force and drive a part has."""
    own_encoder = part.encoder if isinstance(part, CanopenPart) else None
    has = {"position": own_encoder or part.position, "force": part.force, "drive": part.drive}
    return {name for name, config in has.items() if config is not None}


class MixedConfig(AxisConfig):
    """The parts of an axis by name; together they give position, force and drive, each once."""

    driver: Literal["mixed"] = Field(
        description="Encoder, force sensor and drive on different buses or ports."
    )
    parts: dict[str, Annotated[Part, Field(discriminator="driver")]] = Field(
        min_length=1,
        description=(
            "The parts of the axis, by a name of your choice; together they give position, force "
            "and drive, each once."
        ),
    )

    @model_validator(mode="after")
    def _each_once(self) -> MixedConfig:
        for wanted in ("position", "force", "drive"):
            having = [name for name, part in self.parts.items() if wanted in gives(part)]
            if len(having) != 1:
                raise ValueError(
                    f"exactly one part must give {wanted} (`encoder` on CANopen, else `position`), "
                    f"not: {', '.join(having) or 'none'}"
                )
        return self

    @property
    def sample_rate_hz(self) -> float | None:
        """Declared rate of the slowest of position and force; None where none is declared."""
        rates = [rate for part in self.parts.values() if (rate := part.sample_rate_hz) is not None]
        return min(rates, default=None)

    @property
    def paired(self) -> bool:
        """Whether position and force come in different frames, not latched by one SYNC."""
        position, force = (self.parts[self.giving(wanted)] for wanted in ("position", "force"))
        if position is force:
            return position.paired
        return not (isinstance(position, CanopenPart) and isinstance(force, CanopenPart))

    @property
    def force_from_drive(self) -> bool:
        """Whether the force is a motor's torque."""
        return self.parts[self.giving("force")].force_from_drive

    def stamp_deviation_s(self, period_s: float) -> float:
        """Return the standard deviation of the time between a position's stamp and a force's."""
        position, force = (self.parts[self.giving(wanted)] for wanted in ("position", "force"))
        if position is force:
            return position.stamp_deviation_s(period_s)
        return math.hypot(*(one.arrival_deviation_s(period_s) for one in (position, force)))

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that any part lacks."""
        lacks: dict[UnsafeWord, str] = {}
        for name, part in self.parts.items():
            lacks |= {word: f"part {name}: {why}" for word, why in part.unsafe().items()}
        return lacks

    def giving(self, wanted: str) -> str:
        """Return the name of the part that gives position, force or drive."""
        return next(name for name, part in self.parts.items() if wanted in gives(part))


@kernel
def join_samples(
    parts: StoredSample,
    positions: StoredSample,
    forces: StoredSample,
    drives: StoredSample,
    samples: StoredSample,
) -> bool:
    """Fill a sample (1,) from those of the parts (n,); return whether it is valid.

    The part of each value is there a second time (1,). The first fault is kept; how many cycles
    lack a valid sample is left as it is, where this one does.
    """
    position: Any = positions[0]
    force: Any = forces[0]
    drive: Any = drives[0]
    sample: Any = samples[0]
    sample.valid = position.valid > 0 and force.valid > 0
    sample.position, sample.position_stamp_ns = position.position, position.position_stamp_ns
    sample.force, sample.force_stamp_ns = force.force, force.force_stamp_ns
    sample.stamp_ns = min(position.position_stamp_ns, force.force_stamp_ns)
    sample.device_stamp_ns, sample.enabled = position.device_stamp_ns, drive.enabled
    sample.has_drive_position = drive.has_drive_position
    sample.drive_position = drive.drive_position
    sample.has_drive_force, sample.drive_force = drive.has_drive_force, drive.drive_force
    sample.switch = sample.rejected = sample.fault = 0
    for index in range(len(parts)):
        part: Any = parts[index]
        sample.switch |= part.switch
        sample.rejected += part.rejected
        if sample.fault == 0:
            sample.fault = part.fault
    if sample.valid > 0:
        sample.missing = 0
    return bool(sample.valid > 0)


class MixedAxis:
    """Several axes as one: position, force and drive each from its own part."""

    def __init__(self, config: MixedConfig, parts: Mapping[str, Axis]) -> None:
        self._stored: StoredSample = np.zeros(len(parts), SAMPLE_TYPE)
        self._parts = [
            (name, part, Sample(self._stored[row : row + 1]))
            for row, (name, part) in enumerate(parts.items())
        ]
        self._readers = [(part.read_into, own) for _, part, own in self._parts]
        self._driven = parts[config.giving("drive")]
        samples = {name: sample for name, _, sample in self._parts}
        self._position = samples[config.giving("position")]
        self._force = samples[config.giving("force")]
        self._drive = samples[config.giving("drive")]
        self._bind(Sample())

    @property
    def counters(self) -> dict[str, int]:
        """Return the counters of all parts, named after them."""
        return {
            f"{name}.{reason}": count
            for name, part, _ in self._parts
            for reason, count in getattr(part, "counters", {}).items()
        }

    def configure(self) -> None:
        """Find, check and configure all devices; nothing moves. Raises AxisError."""
        for _, part, _ in self._parts:
            part.configure()
        self._sample.missing = 0

    def arm(self) -> None:
        """Ask the drive to hold its present position under power. Raises AxisError."""
        for _, part, _ in self._parts:
            part.arm()

    def read_into(self, sample: Sample) -> None:
        """Read every part. Never raises."""
        if sample is not self._sample:
            self._bind(sample)
        complaint = ""
        for read_into, own in self._readers:
            read_into(own)
            complaint = own.complaint or complaint
        sample.stale, sample.complaint = "", complaint
        if not self._join():
            sample.stale = self._position.stale or self._force.stale
            sample.missing += 1

    def _bind(self, sample: Sample) -> None:
        """Fill this sample from now on."""
        self._sample = sample
        filled = self._position, self._force, self._drive, sample
        self._join = bound(join_samples, (self._stored, *(one.stored for one in filled)))

    def watch(self, seconds: float) -> None:
        """Wait so long, and note the time of each arrival meanwhile."""
        watched = [one for _, part, _ in self._parts for one in getattr(part, "watched", ())]
        keep_arrivals(watched, seconds)

    def write(self, position: float) -> None:
        """Command a position [rig unit]."""
        self._driven.write(position)

    def stop(self) -> None:
        """Stop the drive. Never raises."""
        for _, part, _ in self._parts:
            part.stop()

    def close(self) -> None:
        """Stop the drive and release every device."""
        for _, part, _ in self._parts:
            part.close()
