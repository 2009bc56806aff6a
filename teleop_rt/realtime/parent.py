"""Tie a process to the one that started it, and tell that one how it goes."""

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

_PR_SET_PDEATHSIG = 1
_LOOK_EVERY_S = 0.5


class Tell(Protocol):
    """How a process says how it goes."""

    def __call__(self, event: str, **content: Any) -> None:
        """Tell an event."""


def end_with_parent() -> None:
    """Get SIGTERM when the starting process ends, however it ends; called in the main thread."""
    parent = os.getppid()
    if not _told_by_kernel():
        _look_for(parent)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


def _told_by_kernel() -> bool:
    """Ask the kernel to tell of the parent's end; false where a sandbox refuses that."""
    refused: int = ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    return refused == 0


def _look_for(parent: int) -> None:
    """Look now and then whether the parent is still there: by an alarm, for a thread would cost."""

    def look(*_: object) -> None:
        if os.getppid() != parent:
            signal.setitimer(signal.ITIMER_REAL, 0)
            os.kill(os.getpid(), signal.SIGTERM)

    signal.signal(signal.SIGALRM, look)
    signal.setitimer(signal.ITIMER_REAL, _LOOK_EVERY_S, _LOOK_EVERY_S)
    atexit.register(signal.setitimer, signal.ITIMER_REAL, 0)


def tell_parent(event: str, **content: Any) -> None:
    """Write one line of JSON to standard output."""
    sys.stdout.write(json.dumps({"event": event, **content}) + "\n")
    sys.stdout.flush()


@contextmanager
def telling_problems(tell: Tell) -> Iterator[None]:
    """Tell what goes wrong inside as an event, and raise it again."""
    try:
        yield
    except ExpectedError as error:
        tell("problem", message=str(error))
        raise
    except Exception as error:
        tell("problem", message=f"{type(error).__name__}: {error}")
        raise
