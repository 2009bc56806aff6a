"""Tie a process to the one that started it, and send that one events."""

from __future__ import annotations

import atexit
import ctypes
import json
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Protocol

from teleop_rt.errors import ExpectedError

_PR_SET_PDEATHSIG = 1  # of linux/prctl.h
_LOOK_EVERY_S = 0.5
"""Period in which a process checks its parent where the kernel sends no signal."""


class Emit(Protocol):
    """A function that reports events of a process."""

    def __call__(self, event: str, **content: Any) -> None:
        """Report an event."""


def end_with_parent() -> None:
    """Get SIGTERM when the starting process ends, however it ends; called in the main thread."""
    parent = os.getppid()
    if not _signalled_by_kernel():
        _look_for(parent)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


def _signalled_by_kernel() -> bool:
    """Ask the kernel for a signal at the parent's end; false if a sandbox refuses that."""
    refused: int = ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    return refused == 0


def _look_for(parent: int) -> None:
    """Check regularly whether the parent still runs: by an alarm, because a thread costs more."""

    def look(*_: object) -> None:
        if os.getppid() != parent:
            signal.setitimer(signal.ITIMER_REAL, 0)
            os.kill(os.getpid(), signal.SIGTERM)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, _LOOK_EVERY_S, _LOOK_EVERY_S)
    atexit.register(signal.setitimer, signal.ITIMER_REAL, 0)


def emit_to_parent(event: str, **content: Any) -> None:
    """Write one line of JSON to standard output."""
    sys.stdout.write(json.dumps({"event": event, **content}) + "\n")
    sys.stdout.flush()


@contextmanager
def emitting_problems(emit: Emit) -> Iterator[None]:
    """Report an exception inside as an event, and raise it again."""
    try:
        yield
    except ExpectedError as error:
        emit("problem", message=str(error))
        raise
    except Exception as error:
        emit("problem", message=f"{type(error).__name__}: {error}")
        raise
