"""Tie a process to the one that started it, and tell that one how it goes."""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
from typing import Any, Protocol

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
