"""One process compiles a kernel; others that need it wait, and load it from the cache."""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LONGEST_WAIT_S = 120.0
"""Time [s] after which a process compiles by itself, this kernel and all that are locked later.

A process that was stopped keeps its lock. The largest kernel takes 20 s on a desktop, and some four
times that on a small board.
"""
_POLL_S = 0.02  # against seconds of compiling
_given_up = False  # whether this process has waited without success


@contextmanager
def only_process(file: Path) -> Iterator[None]:
    """Hold the lock of a file, which is created; without the right to create it, hold none.

    So is its folder: else the first kernel of each, such as the bank's, would have no lock.
    The end of a process, however it comes, releases its locks.
    """
    descriptor = None
    with suppress(OSError):
        file.parent.mkdir(exist_ok=True)
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o600)
    try:
        if descriptor is not None:
            _wait_for(descriptor)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _wait_for(descriptor: int) -> None:
    global _given_up  # noqa: PLW0603 - of the process, as its locks are
    until = time.monotonic() + (0.0 if _given_up else LONGEST_WAIT_S)
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= until:
                _given_up = True
                return
            time.sleep(_POLL_S)
        except OSError:
            return  # a file system without locks
        else:
            return
