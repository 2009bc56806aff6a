"""Two ends of a CAN bus in one process, where sending is delivering: no threads, no waiting."""

from __future__ import annotations

import errno
from collections import deque
from typing import TYPE_CHECKING

import can

from teleop_rt_drivers.can_frames import UNREADABLE, flagged_id, plain_message

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from teleop_rt_drivers.can_frames import CanFrame, Outgoing

    Travelling = can.Message | Outgoing
    """A frame as it was sent: a tuple takes a fraction of the time of python-can's message."""

QUEUE = 4096
"""Frames that wait to be read; older ones are lost, as in a controller's full buffer."""
TRANSMIT_QUEUE = 10
"""Frames that wait at most, as on a SocketCAN interface."""


def as_sent(frame: Travelling) -> Outgoing:
    """Return id, with SocketCAN's flags, and bytes of a frame, however it travels."""
    return frame if isinstance(frame, tuple) else (flagged_id(frame), bytes(frame.data))


class SynchronousBus(can.BusABC):
    """One end of a bus; `synchronous_pair` makes both.

    `send` puts the frame into the other end's queue and calls the other end's `on_arrival`, so
    that the answers are queued before `send` returns. A full queue drops its oldest frames. For
    devices that send of their own accord, `recv` on an empty queue calls `before_recv`.
    """

    def __init__(self, channel: str) -> None:
        self._queue: deque[Travelling] = deque(maxlen=QUEUE)
        self._other: SynchronousBus | None = None
        self.on_arrival: Callable[[], None] | None = None
        self.before_recv: Callable[[], None] | None = None
        self.channel_info = f"synchronous bus, {channel}"
        super().__init__(channel)
        self._unsent: deque[Travelling] = deque()
        self._acknowledged = self._plugged = True
        self._is_shutdown = True  # there is nothing to release, and so nothing to forget

    def connect(self, other: SynchronousBus) -> None:
        """Make `other` the end that hears this one."""
        self._other = other

    def deliver(self, frame: Travelling) -> None:
        """Take a frame from the other end, and answer it."""
        self._queue.append(frame)
        if self.on_arrival is not None:
            self.on_arrival()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - python-can's signature
        """Deliver a frame and let the other end answer at once."""
        self.transmit(msg)

    def send_frame(self, can_id: int, data: bytes) -> None:
        """Deliver a frame of classic CAN, as `send` does."""
        self.transmit((can_id, data))

    def send_frames(self, frames: Sequence[Outgoing]) -> None:
        """Deliver frames of classic CAN one after the other, as `send` does."""
        for frame in frames:
            self.transmit(frame)

    def transmit(self, frame: Travelling) -> None:
        """Deliver a frame, or keep it while nobody acknowledges. Raises CanOperationError."""
        if self._other is None or not self._plugged:
            raise can.CanOperationError("the other end of the bus is not connected")
        if self._acknowledged:
            self._other.deliver(frame)
        elif len(self._unsent) < TRANSMIT_QUEUE:
            self._unsent.append(frame)
        else:
            raise can.CanOperationError("No buffer space available", errno.ENOBUFS)

    def flush_tx_buffer(self) -> None:
        """Drop the frames that wait to be sent."""
        self._unsent.clear()

    def lose_other(self) -> None:
        """Let nobody acknowledge the other end's frames: they wait, and fill its queue."""
        if self._other is not None:
            self._other._acknowledged = False  # noqa: SLF001 - its twin

    def find_other(self) -> None:
        """Acknowledge again: frames that waited at the other end come at once."""
        other = self._other
        if other is not None:
            other._acknowledged = True  # noqa: SLF001 - its twin
            while other._unsent:  # noqa: SLF001 - its twin
                self.deliver(other._unsent.popleft())  # noqa: SLF001 - its twin

    def unplug_other(self) -> None:
        """Take the other end's adapter away."""
        if self._other is not None:
            self._other._plugged = False  # noqa: SLF001 - its twin

    def recv(self, timeout: float | None = None) -> can.Message | None:  # noqa: ARG002 - nothing can arrive while waiting
        """Return the next frame, or None at once."""
        if not self._plugged:
            raise can.CanOperationError("the adapter is gone", errno.ENODEV)
        frame = self._next()
        return plain_message(*frame) if isinstance(frame, tuple) else frame

    def waiting_frames(self, most: int) -> list[CanFrame]:
        """Return the frames that have come, `most` at most; never raises, as on other buses."""
        if not self._plugged:
            return [(UNREADABLE, b"", 0)] * most
        frames: list[CanFrame] = []
        queue = self._queue
        for _ in range(most):
            if not queue and not self._asked():
                break
            frame = queue.popleft()
            can_id, data = frame if type(frame) is tuple else as_sent(frame)
            frames.append((can_id, data, 0))
        return frames

    def _asked(self) -> bool:
        """Let devices send due frames; return whether something came."""
        if self.before_recv is not None:
            self.before_recv()
        return bool(self._queue)

    def _next(self) -> Travelling | None:
        return self._queue.popleft() if self._queue or self._asked() else None


def synchronous_pair() -> tuple[SynchronousBus, SynchronousBus]:
    """Return the daemon's end and the devices' end of a new bus."""
    daemon, devices = SynchronousBus("daemon"), SynchronousBus("devices")
    daemon.connect(devices)
    devices.connect(daemon)
    return daemon, devices
