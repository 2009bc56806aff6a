"""A CAN bus as a source of frames that a DBC file describes."""

from __future__ import annotations

import contextlib
import select
import time
from typing import TYPE_CHECKING

import can

from teleop_rt.axis import NO_AXIS_FAULT, AxisError, AxisFault
from teleop_rt_drivers.bus import descriptor_of, stamps_arrivals
from teleop_rt_drivers.can_frames import monotonic_stamp
from teleop_rt_drivers.canopen.watch import error_frame_fault, purge, send_fault
from teleop_rt_drivers.framed.dbc import EXTENDED, DbcMessage, load_dbc
from teleop_rt_drivers.framed.stream import arrived_between

if TYPE_CHECKING:
    from collections.abc import Sequence

    from teleop_rt_drivers.framed.config import RawCanPart
    from teleop_rt_drivers.framed.source import Values
    from teleop_rt_drivers.framed.stream import Watched

MOST_FRAMES_PER_CYCLE = 256
SEND_FAILURES_FAULT = 3
LATE_STAMP_NS = 100_000
"""A frame may be stamped so long before it can be read, and so before the bus was last empty."""


class CanEnd:
    """The daemon's end of a CAN bus that it takes over and closes: frames in, frames out, faults.

    A subclass says what a frame means: `take`.
    """

    def __init__(self, bus: can.BusABC, counters: dict[str, int]) -> None:
        self.fault = NO_AXIS_FAULT
        self._bus = bus
        self._counters = counters
        self._send_failures = 0
        self._kept: list[tuple[can.Message, int]] = []
        self._stamps = stamps_arrivals(bus)
        self.descriptor = -1 if self._stamps else descriptor_of(bus)
        self.empty_ns = 0
        self.is_terminal = False

    @property
    def watched(self) -> Sequence[Watched]:
        """Return the bus, whose arrivals can be kept."""
        return (self,)

    def keep(self) -> None:
        """Keep what has arrived with its time; what cannot be read is left for `drain`."""
        now_ns = time.monotonic_ns()
        arrived_ns, self.empty_ns = arrived_between(self.empty_ns, now_ns), now_ns
        with contextlib.suppress(can.CanError, OSError, ValueError):
            while len(self._kept) < MOST_FRAMES_PER_CYCLE and (frame := self._bus.recv(0)):
                self._kept.append((frame, arrived_ns))

    def begin(self) -> None:
        """Reset: clear the fault."""
        self.fault = NO_AXIS_FAULT
        self._send_failures = 0

    def take(self, frame: can.Message, now_ns: int) -> None:
        """Take a data frame, with the time of its arrival."""
        raise NotImplementedError

    def drain(self, now_ns: int) -> None:
        """Take all that has arrived, as of when it did; a flood is left for the next cycle."""
        for kept, arrived_ns in self._kept:
            self._sort(kept, arrived_ns)
        self._kept.clear()
        found_ns = arrived_between(self.empty_ns, now_ns)
        for _ in range(MOST_FRAMES_PER_CYCLE):
            try:
                frame = self._bus.recv(0)
            except (can.CanError, OSError, ValueError):
                self._counters["unreadable"] += 1
                continue
            if frame is None:
                if self.empty_ns:
                    self.empty_ns = now_ns
                return
            self._sort(frame, self._arrival(frame, found_ns, now_ns))
        self._counters["flood"] += 1

    def _sort(self, frame: can.Message, arrived_ns: int) -> None:
        """Take a data frame; count every other, and find the fault that an error frame reports."""
        if frame.is_error_frame:
            self._counters["error_frame"] += 1
            self.raise_fault(error_frame_fault(frame.arbitration_id, frame.data))
        elif frame.is_remote_frame:
            self._counters["remote_frame"] += 1
        else:
            self.take(frame, arrived_ns)

    def _arrival(self, frame: can.Message, found_ns: int, now_ns: int) -> int:
        """Return when a frame arrived by its own stamp, if that can be: clocks are set."""
        if self._stamps and self.empty_ns:
            stamp_ns = monotonic_stamp(frame)
            if self.empty_ns - LATE_STAMP_NS <= stamp_ns <= now_ns:
                return stamp_ns
        return found_ns

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""
        try:
            select.select([self._bus.fileno()], [], [], timeout_s)
        except NotImplementedError:  # a bus without a descriptor
            time.sleep(timeout_s)

    def transmit(self, frame: can.Message) -> None:
        """Send a frame without waiting; one that is not taken is counted."""
        if self.fault is AxisFault.NOT_ACKNOWLEDGED:
            return  # it would wait, and act when power returns
        try:
            self._bus.send(frame, 0)
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

    def take(self, frame: can.Message, now_ns: int) -> None:
        """Decode a frame; a command that is not ours is a second master's."""
        key = frame.arbitration_id | (EXTENDED if frame.is_extended_id else 0)
        if (message := self._by_key.get(key)) is not None:
            message.receive(bytes(frame.data), now_ns)
            return
        self._counters["unexpected_id"] += 1
        if key in self._own:
            self.raise_fault(AxisFault.FOREIGN_MASTER)

    def send(self, command: str, values: Values) -> None:
        """Send a message of raw values without waiting; one that is not taken is counted."""
        message = self._packed[command]
        self.transmit(
            can.Message(
                arbitration_id=message.key & ~EXTENDED,
                is_extended_id=bool(message.key & EXTENDED),
                data=message.pack(values),
            )
        )
