"""The driver interface: one axis, a handful of methods, the same for hardware and simulator."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Protocol

from teleop_rt.errors import ExpectedError


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


@dataclass(slots=True)
class Sample:
    """One reading of the axis, in the rig's units, reused every cycle.

    Positive position points into the environment; positive force is the tool pressing on it.
    Stamps are monotonic nanoseconds of the SYNC that latched the value, or of its arrival.
    `valid` is true when position and force passed every check and are both new since the last
    cycle, or, from a device that is slower than the loop, not older than its hold time; otherwise
    the numbers are the last valid ones, and `stale` names the device that gave none in time.
    `switch` is true while the axis's home switch, if it has one, is closed. `drive_position` and
    `drive_force` are the drive's own measurements [rig unit], None where it gives none. `complaint`
    is what a device said of itself beside the fault, or which device is behind it.
    """

    stamp_ns: int = 0
    position: float = 0.0
    force: float = 0.0
    position_stamp_ns: int = 0
    force_stamp_ns: int = 0
    device_stamp_ns: int = -1
    valid: bool = False
    stale: str = ""
    enabled: bool = False
    switch: bool = False
    missing: int = 0
    rejected: int = 0
    fault: AxisFault = AxisFault.NONE
    complaint: str = ""
    drive_position: float | None = None
    drive_force: float | None = None


class AxisError(ExpectedError):
    """The rig cannot be used as configured: says what, where and what to do next."""


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
        """Return what bus, frames and drive make of latency, at worst."""

    def configure(self) -> None:
        """Find, check and configure the devices; nothing moves. Raises AxisError."""

    def arm(self) -> None:
        """Ask the drive for power; takes effect over cycles."""

    def read_into(self, sample: Sample) -> None:
        """Drain what has arrived without blocking, and latch the next sample. Never raises."""

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
        """Drain what has arrived without blocking, and latch the next sample.

        Never raises on bad input: it is rejected and counted. Raises EndOfRecording where the
        axis replays a file and the file has ended.
        """

    def write(self, position: float) -> None:
        """Command a position [rig unit], executed at the next latch."""

    def stop(self) -> None:
        """Stop the drive. Never raises, may be called at any time and more than once."""

    def close(self) -> None:
        """Release the devices and the bus."""
