"""Read a rig's force sensor under weights, and turn the fit into keys of its file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.slave.faults import of_axis
from teleop_rt_drivers.calibration.weights import CalibrationError, Weighing
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.framed.config import FramedPart
from teleop_rt_drivers.quantity import FROM_INPUT
from teleop_rt_drivers.registry import parts_of

if TYPE_CHECKING:
    from teleop_rt.axis import Axis
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.calibration.rig_file import KeyPath
    from teleop_rt_drivers.calibration.weights import ForceFit
    from teleop_rt_drivers.canopen.node_config import ForceReading
    from teleop_rt_drivers.framed.signal_config import ForceSignal

    Wait = Callable[[], None]

LARGEST_COUNT = 2.0**63
"""Of a sensor's own numbers."""


def read_force(
    axis: Axis, wait_cycle: Wait, now_ns: Callable[[], int], force: float, seconds: float
) -> Weighing:
    """Read the sensor for a time under a known force, each new value once; nothing is armed.

    Raises CalibrationError where a device has a fault.
    """
    sample, taken, last_ns = Sample(), [], -1
    end_ns = now_ns() + round(1e9 * seconds)
    while now_ns() < end_ns:
        wait_cycle()
        axis.read_into(sample)
        axis.write(sample.position)
        if sample.fault is not AxisFault.NONE:
            found = of_axis(sample.fault)
            raise CalibrationError(f"{found.cause} {sample.complaint}; {found.next_step}")
        if sample.valid and sample.force_stamp_ns != last_ns:
            last_ns = sample.force_stamp_ns
            taken.append(sample.force)
    return Weighing(force, np.array(taken), seconds)


@dataclass(frozen=True, slots=True)
class ScaleInFile:
    """A force sensor's scale in a rig's file: section, unit of the raw value, and values.

    `framed` says that all parts of the rig's axis are framed devices.
    """

    section: KeyPath
    per: str
    scale: float
    offset: float
    framed: bool

    @property
    def raw(self) -> bool:
        """Whether the rig takes the sensor's own numbers, which no weights have scaled yet."""
        return self.framed and self.scale == 1.0 and self.offset == 0.0


def scale_in_file(rig: RigConfig) -> ScaleInFile:
    """Return the scale of the rig's force sensor. Raises CalibrationError if its file has none."""
    for name, part in parts_of(rig.axis).items():
        section = ("axis", "parts", name, "force") if name else ("axis", "force")
        force: ForceReading | ForceSignal | None = None
        if isinstance(part, CanopenPart):
            per, force = "count", part.force_reading
            if part.force == FROM_INPUT:
                section = (*section[:-1], "drive", "force_input")
        elif isinstance(part, FramedPart):
            per, force = "unit", part.force
        if force is None:
            continue
        scale = 1.0 if force.scale is None else force.scale
        framed = all(isinstance(one, FramedPart) for one in parts_of(rig.axis).values())
        return ScaleInFile(section, per, scale, force.offset, framed)
    raise CalibrationError(
        "the rig has no force sensor whose scale is in its file, as one of another package's"
        " driver: put one into axis, or correct the scale where the sensor has it"
    )


def force_keys(rig: RigConfig, fit: ForceFit) -> dict[KeyPath, float]:
    """Return scale, offset and noise of the rig's file by a fit. Raises CalibrationError."""
    unit, found = rig.units.force, scale_in_file(rig)
    return {
        (*found.section, f"scale_{unit}_per_{found.per}"): fit.factor * found.scale,
        (*found.section, f"offset_{unit}"): fit.offset + fit.factor * found.offset,
        ("sensors", f"force_noise_{unit}"): fit.noise,
    }


def any_force(rig: RigConfig) -> RigConfig:
    """Return the rig with a limit of force that a sensor's own numbers do not reach.

    For an axis that is read, and never armed: counts would be rejected as impossible forces.
    """
    limits = rig.limits.model_copy(update={"force_max": LARGEST_COUNT})
    return rig.model_copy(update={"limits": limits})
