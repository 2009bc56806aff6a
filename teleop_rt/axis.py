"""The driver interface: one axis, a handful of methods, the same for hardware and simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from teleop_rt.errors import ExpectedError
from teleop_rt.kernels.record import record_type


class AxisFault(IntEnum):
    """Faults of devices that an axis detects; 0 is none."""

    NONE = 0
    DEVICE_LOST = 1
    BUS_OFF = 2
    ERROR_PASSIVE = 3
    EMERGENCY = 4
    FOREIGN_MASTER = 5
    DUPLICATE_NODE = 6
    DRIVE_FAULT = 7
    UNPLUGGED = 8
    NOT_ACKNOWLEDGED = 9


NO_AXIS_FAULT = AxisFault.NONE
"""By this name a tick finds it at once: in Python 3.11 each look-up in an enum is a call."""


class SampleFields:
    """Numbers of a sample, as kernels read and write them; flags are 0 or 1."""

    stamp_ns: int
    position: float
    force: float
    position_stamp_ns: int
    force_stamp_ns: int
    device_stamp_ns: int
    valid: int
    enabled: int
    switch: int
    missing: int
    rejected: int
    fault: int
    has_drive_position: int
    has_drive_force: int
    drive_position: float
    drive_force: float


SAMPLE_TYPE = record_type(SampleFields)
StoredSample = NDArray[np.record]
_NAMES = list(SampleFields.__annotations__)
_FAULTS = tuple(AxisFault)


def sample_place(field: str) -> int:
    """Return where a field is among the words of a sample."""
    return _NAMES.index(field)


# Any, for each attribute of a sample says its own type.
def _number(name: str) -> Any:
    place = sample_place(name)

    def write(sample: Sample, value: float) -> None:
        sample.floats[place] = value

    return property(lambda sample: sample.floats[place], write)


def _count(name: str, kind: Callable[[int], object] = int) -> Any:
    place = sample_place(name)

    def write(sample: Sample, value: int) -> None:
        sample.counts[place] = value

    return property(lambda sample: kind(sample.counts[place]), write)


def _optional(name: str) -> Any:
    place, has = sample_place(name), sample_place(f"has_{name}")

    def write(sample: Sample, value: float | None) -> None:
        sample.counts[has] = value is not None
        if value is not None:
            sample.floats[place] = value

    return property(lambda sample: sample.floats[place] if sample.counts[has] else None, write)


class Sample:
    """One reading of the axis, in the rig's units, reused every cycle.

    Positive position points into the environment; positive force is the tool pressing on it.
    Stamps are monotonic nanoseconds of the SYNC that latched the value, or of its arrival.
    `valid` is true when position and force passed every check and are both new since the last
    cycle, or, from a device that is slower than the loop, not older than its hold time; otherwise
    the numbers are the last valid ones, and `stale` names the device that gave none in time.
    `switch` is true while the axis's home switch, if it has one, is closed. `drive_position` and
    `drive_force` are the drive's own measurements [rig unit], None where it gives none. `complaint`
    is a device's own report beside the fault, or the name of the device behind it.

    Kernels fill `stored`, a record (1,) of `SampleFields`, which may be a row of a table that they
    read; `floats` and `counts` are its words.
    """

    stamp_ns: int = _count("stamp_ns")
    position: float = _number("position")
    force: float = _number("force")
    position_stamp_ns: int = _count("position_stamp_ns")
    force_stamp_ns: int = _count("force_stamp_ns")
    device_stamp_ns: int = _count("device_stamp_ns")
    valid: bool = _count("valid", bool)
    enabled: bool = _count("enabled", bool)
    switch: bool = _count("switch", bool)
    missing: int = _count("missing")
    rejected: int = _count("rejected")
    fault: AxisFault = _count("fault", _FAULTS.__getitem__)
    drive_position: float | None = _optional("drive_position")
    drive_force: float | None = _optional("drive_force")

    def __init__(self, stored: StoredSample | None = None, **fields: float | str | None) -> None:
        self.stored: StoredSample = np.zeros(1, SAMPLE_TYPE) if stored is None else stored
        words = self.stored.view(np.uint8).data
        self.floats, self.counts = words.cast("d"), words.cast("q")
        self.stale = self.complaint = ""
        self.device_stamp_ns = -1
        for name, value in fields.items():
            setattr(self, name, value)


class AxisError(ExpectedError):
    """The rig cannot be used as configured; the message gives cause, place and next step."""


class EndOfRecording(Exception):  # noqa: N818 - an end, not an error
    """A replaying axis has no more samples."""


@dataclass(frozen=True, slots=True)
class Timing:
    """How old a device's sample is when it is answered, and how long until the force acts [s]."""

    sample_age_s: float
    force_delay_s: float

    @property
    def latency_s(self) -> float:
        """Return the time from a motion of the device to the force that answers it."""
        return self.sample_age_s + self.force_delay_s


class Device(Protocol):
    """An operator's device: a position that is measured, and a force that is commanded."""

    @property
    def timing(self) -> Timing:
        """Return the worst latency that bus, frames and drive cause."""

    def configure(self) -> None:
        """Find, check and configure the devices; nothing moves. Raises AxisError."""

    def arm(self) -> None:
        """Ask the drive for power; takes effect over cycles."""

    def read_into(self, sample: Sample) -> None:
        """Drain arrived frames without blocking, and latch the next sample. Never raises."""

    def push(self, force: float) -> None:
        """Command a force on the hand [rig unit], > 0 along x; none until enabled."""

    def stop(self) -> None:
        """Stop the drive. Never raises, may be called at any time and more than once."""

    def close(self) -> None:
        """Release the devices and the bus."""


class Axis(Protocol):
    """One linear or rotary axis with an encoder, a force sensor and a drive."""

    def configure(self) -> None:
        """Find, check and configure the devices; nothing moves. Raises AxisError."""

    def arm(self) -> None:
        """Ask the drive to hold its present position under power; takes effect over cycles."""

    def read_into(self, sample: Sample) -> None:
        """Drain arrived frames without blocking, and latch the next sample.

        Never raises on bad input: it is rejected and counted. Raises EndOfRecording where the
        axis replays a file and the file has ended.
        """

    def write(self, position: float) -> None:
        """Command a position [rig unit], executed at the next latch."""

    def stop(self) -> None:
        """Stop the drive. Never raises, may be called at any time and more than once."""

    def close(self) -> None:
        """Release the devices and the bus."""
