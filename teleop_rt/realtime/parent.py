"""Tie a process to the one that started it, and tell that one how it goes."""

from __future__ import annotations

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


class Tell(Protocol):
    """How a process says how it goes."""

    def __call__(self, event: str, **content: Any) -> None:
        """Tell an event."""


def end_with_parent() -> None:
    """Ask the kernel for SIGTERM when the starting process ends, however it ends."""
    parent = os.getppid()
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
    if os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)


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
