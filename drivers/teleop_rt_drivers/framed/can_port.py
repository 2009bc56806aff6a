"""A CAN bus as a source of frames that a DBC file describes."""

from __future__ import annotations

import contextlib
import select
import time
from typing import TYPE_CHECKING

import can

from teleop_rt.axis import AxisError, AxisFault
from teleop_rt_drivers.canopen.watch import error_frame_fault, purge, send_fault
from teleop_rt_drivers.framed.dbc import EXTENDED, DbcMessage, load_dbc

if TYPE_CHECKING:
    from teleop_rt_drivers.framed.config import RawCanPart
    from teleop_rt_drivers.framed.source import Values

MOST_FRAMES_PER_CYCLE = 256
SEND_FAILURES_FAULT = 3


class CanPort:
    """The messages that an axis uses, on a bus that the port takes over and closes."""

    def __init__(self, config: RawCanPart, bus: can.BusABC, counters: dict[str, int]) -> None:
        self.fault = AxisFault.NONE
        self._bus = bus
        self._counters = counters
        self._send_failures = 0
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
        """Begin afresh: forget what was wrong."""
        self.fault = AxisFault.NONE
        self._send_failures = 0
        for message in self._by_key.values():
            message.reset()

    def drain(self, now_ns: int) -> None:
        """Decode all that has arrived; a flood is left for the next cycle."""
        counters = self._counters
        for _ in range(MOST_FRAMES_PER_CYCLE):
            try:
                frame = self._bus.recv(0)
            except (can.CanError, OSError, ValueError):
                counters["unreadable"] += 1
                continue
            if frame is None:
                return
            if frame.is_error_frame:
                counters["error_frame"] += 1
                self._raise_fault(error_frame_fault(frame))
            elif frame.is_remote_frame:
                counters["remote_frame"] += 1
            else:
                self._take(frame, now_ns)
        counters["flood"] += 1

    def _take(self, frame: can.Message, now_ns: int) -> None:
        key = frame.arbitration_id | (EXTENDED if frame.is_extended_id else 0)
        if (message := self._by_key.get(key)) is not None:
            message.receive(bytes(frame.data), now_ns)
            return
        self._counters["unexpected_id"] += 1
        if key in self._own:
            self._raise_fault(AxisFault.FOREIGN_MASTER)

    def wait(self, timeout_s: float) -> None:
        """Wait for something to arrive, no longer than that."""
        try:
            select.select([self._bus.fileno()], [], [], timeout_s)
        except NotImplementedError:  # a bus without a descriptor
            time.sleep(timeout_s)

    def send(self, command: str, values: Values) -> None:
        """Send a message of raw values without waiting; one that is not taken is counted."""
        if self.fault is AxisFault.NOT_ACKNOWLEDGED:
            return  # it would wait, and act when power returns
        message = self._packed[command]
        frame = can.Message(
            arbitration_id=message.key & ~EXTENDED,
            is_extended_id=bool(message.key & EXTENDED),
            data=message.pack(values),
        )
        try:
            self._bus.send(frame, 0)
        except (can.CanError, OSError) as error:
            self._counters["send_failed"] += 1
            self._send_failures += 1
            if self._send_failures == SEND_FAILURES_FAULT:
                self._raise_fault(send_fault(error))
                purge(self._bus)
        else:
            self._send_failures = 0

    def close(self) -> None:
        """Release the bus."""
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()

    def _raise_fault(self, fault: AxisFault) -> None:
        if self.fault is AxisFault.NONE:
            self.fault = fault
