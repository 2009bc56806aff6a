"""A CAN bus as a source of frames that a DBC file describes."""

from __future__ import annotations

import contextlib
import select
import time
from typing import TYPE_CHECKING

import can

from teleop_rt.axis import NO_AXIS_FAULT, AxisError, AxisFault
from teleop_rt_drivers.bus import descriptor_of, stamps_arrivals
from teleop_rt_drivers.can_frames import (
    ERROR,
    EXTENDED_MASK,
    MOST_FRAMES_PER_CYCLE,
    REMOTE,
    UNREADABLE,
    reader_of,
    single_sender_of,
    wide_message,
)
from teleop_rt_drivers.canopen.watch import (
    SEND_FAILURES_FAULT,
    error_frame_fault,
    purge,
    send_fault,
)
from teleop_rt_drivers.framed.dbc import DbcMessage, load_dbc
from teleop_rt_drivers.framed.stream import arrived_between

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teleop_rt_drivers.can_frames import CanFrame
    from teleop_rt_drivers.framed.config import RawCanPart
    from teleop_rt_drivers.framed.source import Values
    from teleop_rt_drivers.framed.stream import Watched
    from teleop_rt_drivers.framed.written_frame import StoredAim

LATE_STAMP_NS = 100_000
"""A frame may be stamped so long before it can be read, and so before the bus was last empty."""


class CanEnd:
    """The daemon's end of a CAN bus that it takes over and closes: frames in, frames out, faults.

    A subclass decodes frames: `take`.
    """

    def __init__(self, bus: can.BusABC, counters: dict[str, int]) -> None:
        self.fault = NO_AXIS_FAULT
        self._bus = bus
        self._counters = counters
        self._send_failures = 0
        self._waiting_frames, self._send_frame = reader_of(bus), single_sender_of(bus)
        self._kept: list[tuple[CanFrame, int]] = []
        self._stamps = stamps_arrivals(bus)
        self.descriptor = -1 if self._stamps else descriptor_of(bus)
        self.empty_ns = 0
        self.is_terminal = False

    @property
    def watched(self) -> Sequence[Watched]:
        """Return the bus, whose arrivals can be kept."""
        return (self,)

    def keep(self) -> None:
        """Keep arrived frames with their time; unreadable ones are left for `drain`."""
        now_ns = time.monotonic_ns()
        arrived_ns, self.empty_ns = arrived_between(self.empty_ns, now_ns), now_ns
        if (most := MOST_FRAMES_PER_CYCLE - len(self._kept)) > 0:
            frames = self._waiting_frames(most)
            self._kept += [(frame, arrived_ns) for frame in frames if frame[0] != UNREADABLE]

    def begin(self) -> None:
        """Reset: clear the fault."""
        self.fault = NO_AXIS_FAULT
        self._send_failures = 0

    def take(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Take a data frame, its id with SocketCAN's flags, and the time of its arrival."""
        raise NotImplementedError

    def drain(self, now_ns: int) -> None:
        """Take all that has arrived, as of when it did; a flood is left for the next cycle."""
        if self._kept:
            for kept, arrived_ns in self._kept:
                self._sort(kept, arrived_ns)
            self._kept.clear()
        found_ns = arrived_between(self.empty_ns, now_ns)
        frames = self._waiting_frames(MOST_FRAMES_PER_CYCLE)
        for frame in frames:
            self._sort(frame, self._arrival(frame[2], found_ns, now_ns))
        if len(frames) == MOST_FRAMES_PER_CYCLE:
            self._counters["flood"] += 1
        elif self.empty_ns:
            self.empty_ns = now_ns

    def _sort(self, frame: CanFrame, arrived_ns: int) -> None:
        """Take a data frame; count every other, and find the fault that an error frame reports."""
        can_id, data, _ = frame
        if not (can_id < 0 or can_id & (ERROR | REMOTE)):  # nearly always
            self.take(can_id, bytes(data), arrived_ns)
        elif can_id == UNREADABLE:
            self._counters["unreadable"] += 1
        elif can_id & ERROR:
            self._counters["error_frame"] += 1
            self.raise_fault(error_frame_fault(can_id & EXTENDED_MASK, data))
        else:
            self._counters["remote_frame"] += 1

    def _arrival(self, stamp_ns: int, found_ns: int, now_ns: int) -> int:
        """Return when a frame arrived by its own stamp, if that can be: clocks are set."""
        if self._stamps and self.empty_ns and self.empty_ns - LATE_STAMP_NS <= stamp_ns <= now_ns:
            return stamp_ns
        return found_ns

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""
        try:
            select.select([self._bus.fileno()], [], [], timeout_s)
        except NotImplementedError:  # a bus without a descriptor
            time.sleep(timeout_s)

    def transmit(self, can_id: int, data: bytes, *, wide: bool = False) -> None:
        """Send a frame without waiting, a `wide` one by CAN FD; one that is not taken is counted.

        The id has SocketCAN's flags.
        """
        if self.fault is AxisFault.NOT_ACKNOWLEDGED:
            return  # it would wait, and act when power returns
        try:
            if wide:
                self._bus.send(wide_message(can_id, data), 0)
            else:
                self._send_frame(can_id, data)
        except (can.CanError, OSError) as error:
            self._counters["send_failed"] += 1
            self._send_failures += 1
            if self._send_failures == SEND_FAILURES_FAULT:
                self.raise_fault(send_fault(error))
                purge(self._bus)
        else:
            self._send_failures = 0

    def close(self) -> None:
        """Release the bus."""
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()

    def raise_fault(self, fault: AxisFault) -> None:
        """Latch the first fault; later ones are its consequences."""
        if self.fault is NO_AXIS_FAULT:
            self.fault = fault


class CanPort(CanEnd):
    """The messages of a DBC that an axis uses."""

    def __init__(self, config: RawCanPart, bus: can.BusABC, counters: dict[str, int]) -> None:
        super().__init__(bus, counters)
        received = [signal.source for signal in config.signals.values()]
        received += [config.drive.answer] if config.drive else []
        received += [config.switch.source] if config.switch else []
        sent = [config.drive.command] if config.drive else []
        messages = load_dbc(config.dbc)
        for name in (*received, *sent, *config.messages):
            if name not in messages:
                raise AxisError(
                    f"{config.dbc} has no message {name!r}; it has: {', '.join(sorted(messages))}"
                )
        used = {
            name: DbcMessage(messages[name], config.messages.get(name), counters)
            for name in dict.fromkeys((*received, *sent))
        }
        self.sources = {name: used[name].source for name in received}
        self.commands = {name: used[name].source for name in sent}
        self._packed = {name: used[name] for name in sent}
        self._by_key = {used[name].key: used[name] for name in received}
        self._own = {used[name].key for name in sent}

    def open(self) -> None:
        """Reset: clear the fault."""
        self.begin()
        for message in self._by_key.values():
            message.reset()

    def take(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Decode a frame; a command that is not ours is a second master's."""
        if (message := self._by_key.get(can_id)) is not None:
            message.receive(data, now_ns)
            return
        self._counters["unexpected_id"] += 1
        if can_id in self._own:
            self.raise_fault(AxisFault.FOREIGN_MASTER)

    def target_sender(self, aim: StoredAim) -> None:
        """Return None: a message of a DBC takes `send`."""

    def send(self, command: str, values: Values) -> None:
        """Send a message of raw values without waiting; one that is not taken is counted."""
        message = self._packed[command]
        self.transmit(message.key, message.pack(values))
