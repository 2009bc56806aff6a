"""Two ends of a serial line: in one process, or a pseudo-terminal under a path."""

from __future__ import annotations

import contextlib
import os
import tty
from pathlib import Path
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.framed.stream import DescriptorStream, StreamGoneError

if TYPE_CHECKING:
    from collections.abc import Callable

QUEUE_BYTES = 1 << 16
"""Room of one direction: further bytes are lost, as behind a full serial buffer."""


class PipeStream:
    """One end of a line within a process; `pipe` makes both.

    Before the daemon's end reads, and after it writes, `on_use` lets the devices answer.
    """

    def __init__(self) -> None:
        self.on_use: Callable[[], None] | None = None
        self.kept: list[tuple[int, bytes]] = []
        self.arrived_ns = 0
        self._arrived = bytearray()
        self._other: PipeStream | None = None
        self._gone = False

    def connect(self, other: PipeStream) -> None:
        """Make `other` the end that hears this one."""
        self._other = other

    def read(self) -> bytes:
        """Return the arrived bytes. Raises StreamGoneError after either end was closed."""
        if self.on_use is not None:
            self.on_use()
        if self._gone:
            raise StreamGoneError("the other end is closed")
        data = bytes(self._arrived)
        self._arrived.clear()
        return data

    def write(self, data: bytes) -> bool:
        """Send; bytes that do not fit into the other end's queue are lost."""
        if self._gone or self._other is None:
            raise StreamGoneError("the other end is closed")
        taken = len(self._other._arrived) + len(data) <= QUEUE_BYTES  # noqa: SLF001 - its twin
        if taken:
            self._other._arrived += data  # noqa: SLF001 - its twin
        if self.on_use is not None:
            self.on_use()
        return taken

    def wait(self, timeout_s: float) -> None:
        """Return at once: nothing can arrive while waiting."""

    def flush(self) -> None:
        """Keep the arrived bytes: on a clock that stands still they would not come again."""

    def close(self) -> None:
        """Close both ends."""
        self._gone = True
        if self._other is not None:
            self._other._gone = True  # noqa: SLF001 - its twin


def pipe() -> tuple[PipeStream, PipeStream]:
    """Return the daemon's end and the device's end of a new line."""
    daemon, device = PipeStream(), PipeStream()
    daemon.connect(device)
    device.connect(daemon)
    return daemon, device


class PseudoTerminal(DescriptorStream):
    """The device's end of a pseudo-terminal; `path` becomes a link to the end to open."""

    def __init__(self, path: str) -> None:
        self._path = Path(path)
        descriptor, self._other = os.openpty()
        super().__init__(descriptor)
        tty.setraw(self._other)
        os.set_blocking(descriptor, False)
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            if self._path.is_symlink():
                self._path.unlink()
            self._path.symlink_to(os.ttyname(self._other))
        except OSError as error:
            self._close_ends()
            raise AxisError(
                f"cannot offer a pseudo-terminal as {path}: {error}; choose another `folder` for "
                "the simulated ports"
            ) from error

    def close(self) -> None:
        """Pull the cable, and take the link away."""
        with contextlib.suppress(OSError):
            if self._path.readlink() == Path(os.ttyname(self._other)):
                self._path.unlink()
                self._path.parent.rmdir()  # refused, as it should be, while others are in it
        self._close_ends()

    def _close_ends(self) -> None:
        os.close(self._other)
        os.close(self._descriptor)
