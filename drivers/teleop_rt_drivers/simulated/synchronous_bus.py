"""Two ends of a CAN bus in one process, where sending is delivering: no threads, no waiting."""

from __future__ import annotations

import errno
from collections import deque
from typing import TYPE_CHECKING

import can

if TYPE_CHECKING:
    from collections.abc import Callable

QUEUE = 4096
TRANSMIT_QUEUE = 10
"""Frames that wait at most, as on a SocketCAN interface."""


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
        self._unsent: deque[can.Message] = deque()
        self._acknowledged = self._plugged = True
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
        if self._other is None or not self._plugged:
            raise can.CanOperationError("the other end of the bus is not connected")
        if self._acknowledged:
            self._other.deliver(msg)
        elif len(self._unsent) < TRANSMIT_QUEUE:
            self._unsent.append(msg)
        else:
            raise can.CanOperationError("No buffer space available", errno.ENOBUFS)

    def flush_tx_buffer(self) -> None:
        """Drop what waits to be sent."""
        self._unsent.clear()

    def lose_other(self) -> None:
        """Let nobody acknowledge what the other end sends: its frames wait, and fill its queue."""
        if self._other is not None:
            self._other._acknowledged = False  # noqa: SLF001 - its twin

    def find_other(self) -> None:
        """Acknowledge again: what waited at the other end comes at once."""
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
        if not self._queue and self.before_recv is not None:
            self.before_recv()
        return self._queue.popleft() if self._queue else None


def synchronous_pair() -> tuple[SynchronousBus, SynchronousBus]:
    """Return the daemon's end and the devices' end of a new bus."""
    daemon, devices = SynchronousBus("daemon"), SynchronousBus("devices")
    daemon.connect(devices)
    devices.connect(daemon)
    return daemon, devices
