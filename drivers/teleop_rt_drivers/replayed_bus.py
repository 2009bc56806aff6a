"""A logged CAN bus in place of a live one: the same decoding, on frames of the past.

A cycle of the daemon that was logged began with its SYNC (CANopen) or ended with its command
(raw CAN): between two of them lie the frames of one cycle.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import can
from can.io.blf import BLFParseError, BLFReader

from teleop_rt.axis import AxisError, EndOfRecording
from teleop_rt_drivers.bounded_file import refuse_huge

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from teleop_rt.axis import Sample

REPLAY = "replay"
"""The bus's `interface` that names a log: its `channel` is the file."""


class ReplayBus(can.BusABC):
    """Hands out the devices' frames, cycle by cycle; frames sent to it go nowhere.

    `mark` identifies the daemon's frames that separate its cycles, `ours` all frames that it sent.
    """

    def __init__(self, file: str, mark: Callable[[int], bool], ours: Callable[[int], bool]) -> None:
        self.channel_info = f"replay of {file}"
        self._cycles: list[list[can.Message]] = []
        self._stamps_ns: list[int] = []
        self._at = 0
        self._given = 0
        self._started_ns = 0
        self._read(file, mark, ours)
        super().__init__(channel=file)
        self._is_shutdown = True  # there is nothing to release

    def _read(self, file: str, mark: Callable[[int], bool], ours: Callable[[int], bool]) -> None:
        """Sort the log into cycles; a frame is the devices' until the next mark."""
        waiting: list[can.Message] = []
        for message in _messages(file):
            if mark(message.arbitration_id):
                self._stamps_ns.append(round(message.timestamp * 1e9))
                self._cycles.append(waiting)
                waiting = []
            elif self._stamps_ns and not ours(message.arbitration_id):
                waiting.append(message)
        if not self._cycles:
            raise AxisError(
                f"bus log {file}: no cycle of the daemon is in it: take a log of this rig"
            )

    def start(self, now_ns: int) -> None:
        """Begin with the first cycle, as if it were now."""
        self._at, self._given, self._started_ns = -1, 0, now_ns

    def next_cycle(self) -> None:
        """Go on to the next cycle. Raises EndOfRecording after the last."""
        if self._at + 1 >= len(self._cycles):
            raise EndOfRecording(f"all {len(self._cycles)} cycles of {self.channel_info} are over")
        self._at += 1
        self._given = 0

    def now_ns(self) -> int:
        """Return the time of the cycle, from the start of the replay on."""
        return self._started_ns + self._stamps_ns[max(0, self._at)] - self._stamps_ns[0]

    def recv(self, timeout: float | None = None) -> can.Message | None:  # noqa: ARG002 - python-can's signature
        """Return the next frame of this cycle, or None."""
        if self._at < 0 or self._given >= len(self._cycles[self._at]):
            return None
        self._given += 1
        return self._cycles[self._at][self._given - 1]

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send nothing: the past does not answer."""


def _messages(file: str) -> list[can.Message]:
    """Read a log. Raises AxisError naming the file."""
    path = Path(file)
    if not path.is_file():
        raise AxisError(f"bus log {file}: no such file: correct bus.channel")
    refuse_huge(path, f"bus log {file}")
    try:
        if path.suffix == ".blf":
            with path.open("rb") as binary:
                return list(BLFReader(binary))
        with path.open(encoding="utf-8") as text:
            return list(can.ASCReader(text))
    except (can.CanError, OSError, ValueError, LookupError, struct.error, BLFParseError) as error:
        raise AxisError(f"bus log {file}: cannot be read: {error}: give a .asc or .blf") from error


class ListeningAxis(Protocol):
    """An axis that can begin on devices that somebody else configured."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Rejected frames by reason, and further events."""

    def listen(self) -> None:
        """Begin with frames that arrive from now on."""

    def read_into(self, sample: Sample) -> None:
        """Take the frames that have arrived."""


class ReplayAxis:
    """An axis on a logged bus: the motion is the log's, commands are not executed."""

    def __init__(self, axis: ListeningAxis, bus: ReplayBus, now_ns: Callable[[], int]) -> None:
        self.counters = axis.counters
        self._axis = axis
        self._bus = bus
        self._now_ns = now_ns

    def configure(self) -> None:
        """Begin with the first cycle."""
        self._bus.start(self._now_ns())
        self._axis.listen()

    def arm(self) -> None:
        """Do nothing: there is no drive."""

    def read_into(self, sample: Sample) -> None:
        """Decode the frames of the next cycle. Raises EndOfRecording after the last."""
        self._bus.next_cycle()
        self._axis.read_into(sample)
        sample.enabled = True

    def write(self, position: float) -> None:
        """Do nothing: the motion is the log's."""

    def stop(self) -> None:
        """Do nothing: nothing moves."""

    def close(self) -> None:
        """Do nothing: the file was read at the start."""
