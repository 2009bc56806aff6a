"""The shape that all makers' protocols have here: frames out for an order, a report of frames in.

A codec knows bytes alone: no bus, no clock, no scale. Positions are in the drive's own unit, turn
or rad, velocities in that per second, torques in Nm.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, NamedTuple, Protocol

AngleUnit = Literal["turn", "rad"]
RADIANS_PER_UNIT: dict[AngleUnit, float] = {"turn": 6.283185307179586, "rad": 1.0}


class Frame(NamedTuple):
    """A CAN frame, or a packet on a serial line: its id, 0 here, stands in its bytes."""

    can_id: int
    data: bytes
    extended: bool = False
    fd: bool = False


Frames = tuple[Frame, ...]


class DriveState(IntEnum):
    """The state of a drive, independent of its protocol."""

    OFF = 0
    FOLLOWING = 1
    BUSY = 2
    FAULT = 3


class Taken(IntEnum):
    """Kind of a received frame; a NOTED one contains neither position nor state.

    A PLACED one contains a position alone: it answers a question, never a command.
    """

    MEASURED = 0
    STATE = 1
    OTHER = 2
    FOREIGN = 3
    REFUSED = 4
    NOTED = 5
    PLACED = 6


@dataclass(slots=True)
class Report:
    """The last report of a drive; `refusal` is the counter of the last rejected frame.

    `complaint` is the drive's fault in words, empty for none.
    """

    position: float = 0.0
    velocity: float = 0.0
    torque: float = 0.0
    state: DriveState = DriveState.BUSY
    complaint: str = ""
    refusal: str = ""

    def refuse(self, counter: str) -> Taken:
        """Note why a frame was refused."""
        self.refusal = counter
        return Taken.REFUSED


class Codec(Protocol):
    """A maker's protocol for one drive. Nothing raises on any bytes.

    `asks`: the drive only answers requests, and sends nothing by itself.
    `reports_time_out`: the drive reports that it let go because no command came.
    """

    unit: AngleUnit
    asks: bool
    reports_time_out: bool

    @property
    def reach(self) -> float:
        """Largest position of either sign that a command can hold."""

    def opening(self) -> Frames:
        """Return the frames sent once to a drive without power: limits, faults cleared."""

    def enable(self, position: float) -> Frames:
        """Return the frames that switch power on, to hold at this position."""

    def disable(self) -> Frames:
        """Return the frames that switch power off; a drive that `asks` answers with a report."""

    def follow(self, position: float, velocity: float) -> Frames:
        """Return the order to go to a position, at a velocity."""

    def brake(self) -> Frames:
        """Return the order to come to rest under power."""

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take a frame of the bus into the report; a refused one changes nothing."""


class TorqueCodec(Codec, Protocol):
    """A protocol in which a drive can be asked for a torque."""

    def push(self, torque: float) -> Frames:
        """Return the order to push with a torque [Nm], whatever the position."""


class AskedCodec(TorqueCodec, Protocol):
    """A protocol in which a drive can be asked where it is without being commanded."""

    def question(self) -> Frame:
        """Return the frame that asks for the position, and is answered by one frame."""


class LineCodec(Codec, Protocol):
    """A protocol of packets on a half-duplex serial line: asked and answered in turn."""

    header: bytes
    longest: int
    """Longest packet [byte] that is waited for."""
    answer_bytes: int
    """Longest answer to an order [byte]."""

    def size(self, begun: bytearray) -> int:
        """Return the size of the packet that begins here, 0 while too little of it is there."""

    def sound(self, packet: bytes) -> bool:
        """Return whether a packet's checksum is right."""
