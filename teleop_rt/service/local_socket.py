"""Unix sockets at paths of any length: the kernel's own limit is 108 bytes."""

from __future__ import annotations

import os
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

MODE = 0o660
"""The owner and the group of the daemon may command it; nobody else."""
BACKLOG = 200
"""Connections that wait to be taken in: as many as are taken in at once."""
_TIMEOUT = struct.Struct("ll")


@contextmanager
def _short(path: Path) -> Iterator[str]:
    folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{folder}/{path.name}"
    finally:
        os.close(folder)


def bind(path: Path) -> socket.socket:
    """Return a socket that listens at `path`, which only owner and group may use.

    It takes the place of one that is there without a moment between.
    """
    fresh = path.with_name(f"{path.name}.next")
    fresh.unlink(missing_ok=True)
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    with _short(fresh) as name:
        listening.bind(name)
    fresh.chmod(MODE)
    listening.listen(BACKLOG)
    fresh.replace(path)
    return listening


def connect(path: Path, timeout_s: float) -> socket.socket:
    """Return a connection to the socket at `path`, waiting for room there. Raises OSError."""
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    # By the kernel: a connection that does not block is refused where others wait already.
    timeout = _TIMEOUT.pack(int(timeout_s), round(timeout_s % 1 * 1e6))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, timeout)
    try:
        with _short(path) as name:
            connection.connect(name)
    except OSError:
        connection.close()
        raise
    connection.settimeout(timeout_s)
    return connection
