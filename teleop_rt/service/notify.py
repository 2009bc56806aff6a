"""Notifications to systemd (sd_notify): the daemon is ready, and its loop runs.

The loop itself feeds the watchdog, in its tick, so a hung loop does not. If the loop pauses on
purpose, while devices are configured again, the time-out is that of a start.
"""

from __future__ import annotations

import contextlib
import os
import socket
import time
from collections.abc import Mapping

_FEEDS_PER_TIMEOUT = 4
"""Feeds of the watchdog in its period: systemd recommends every half."""
_STANDSTILL_US = 300_000_000
"""Longest duration of a start: TimeoutStartSec of the unit."""


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
        self._timeout_us = timeout_us
        self._ticks = 0

    def tick(self) -> None:
        """Feed the watchdog when it is time; called by the loop, once a tick."""
        if self._feed_every:
            self._ticks += 1
            if self._ticks >= self._feed_every:
                self._ticks = 0
                self.send(b"WATCHDOG=1")

    def going(self) -> None:
        """Say that the loop begins: from now on only its ticks feed the watchdog."""
        self._allow(self._timeout_us)
        self.send(b"READY=1")

    def standing(self, *, reloading: bool) -> None:
        """Say that the loop stands still on purpose, no longer than a start may take."""
        self._allow(_STANDSTILL_US)
        if reloading:
            now_us = time.clock_gettime_ns(time.CLOCK_MONOTONIC) // 1000
            self.send(b"RELOADING=1\nMONOTONIC_USEC=%d" % now_us)

    def _allow(self, timeout_us: int) -> None:
        if self._feed_every:
            self.send(b"WATCHDOG_USEC=%d" % timeout_us)

    def send(self, message: bytes) -> None:
        """Send a message such as STOPPING=1."""
        if self._socket is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(message, self._address)

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
