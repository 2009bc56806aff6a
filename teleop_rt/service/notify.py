"""What systemd is told (sd_notify): that the daemon is ready, and that its loop goes on.

The watchdog is fed by the loop itself, in its own tick: a loop that hangs is not fed for.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Mapping

_FEEDS_PER_TIMEOUT = 4


class Notifier:
    """Datagrams to the service manager; without one, nothing. Never blocks, never raises."""

    def __init__(self, period_ns: int, environment: Mapping[str, str] = os.environ) -> None:
        """Read NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID; `period_ns` is the loop's."""
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) if address else None
        if self._socket is not None:
            self._socket.settimeout(0.0)
        timeout_us = int(environment.get("WATCHDOG_USEC", "0"))
        meant = environment.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        fed = self._address and meant and timeout_us > 0
        feed_ns = timeout_us * 1000 // _FEEDS_PER_TIMEOUT
        self._feed_every = max(1, feed_ns // period_ns) if fed else 0
        self._ticks = 0

    def tick(self) -> None:
        """Feed the watchdog when it is time; called by the loop, once a tick."""
        if self._feed_every:
            self._ticks += 1
            if self._ticks >= self._feed_every:
                self._ticks = 0
                self.send(b"WATCHDOG=1")

    def send(self, message: bytes) -> None:
        """Send a message such as READY=1."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(message, self._address)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
