"""Two ends of a CAN bus in one process, where sending is delivering: no threads, no waiting."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import can

if TYPE_CHECKING:
    from collections.abc import Callable

QUEUE = 4096


class SynchronousBus(can.BusABC):
    """One end of a bus; `synchronous_pair` makes both.

    `send` puts the frame into the other end's queue and calls the other end's `on_arrival`, so
    that the answers are queued before `send` returns. A full queue drops its oldest frames. For
    devices that send of their own accord, `recv` on an empty queue calls `before_recv`.
    """

    def __init__(self, channel: str) -> None:
        self._queue: deque[can.Message] = deque(maxlen=QUEUE)
        self._other: SynchronousBus | None = None
        self.on_arrival: Callable[[], None] | None = None
        self.before_recv: Callable[[], None] | None = None
        self.channel_info = f"synchronous bus, {channel}"
        super().__init__(channel)
        self._is_shutdown = True  # there is nothing to release, and so nothing to forget

    def connect(self, other: SynchronousBus) -> None:
        """Make `other` the end that hears this one."""
        self._other = other

    def deliver(self, msg: can.Message) -> None:
        """Take a frame from the other end, and answer it."""
        self._queue.append(msg)
        if self.on_arrival is not None:
            self.on_arrival()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 - python-can's signature
        """Deliver a frame and let the other end answer at once."""
        if self._other is None:
            raise can.CanOperationError("the other end of the bus is not connected")
        self._other.deliver(msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:  # noqa: ARG002 - nothing can arrive while waiting
        """Return the next frame, or None at once."""
        if not self._queue and self.before_recv is not None:
            self.before_recv()
        return self._queue.popleft() if self._queue else None


def synchronous_pair() -> tuple[SynchronousBus, SynchronousBus]:
    """Return the daemon's end and the devices' end of a new bus."""
    daemon, devices = SynchronousBus("daemon"), SynchronousBus("devices")
    daemon.connect(devices)
    devices.connect(daemon)
    return daemon, devices
