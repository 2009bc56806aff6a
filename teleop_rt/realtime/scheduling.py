"""What the loop asks of the operating system, each reported as obtained or refused."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
from dataclasses import dataclass

import numpy as np

_MCL_CURRENT, _MCL_FUTURE = 1, 2
_PR_SET_TIMERSLACK = 29


@dataclass(frozen=True, slots=True)
class Privilege:
    """One thing asked of the system: whether it was granted, and how to grant it."""

    name: str
    granted: bool
    reason: str
    how_to_grant: str

    def describe(self) -> str:
        """Return it as a sentence."""
        if self.granted:
            return f"{self.name}: granted ({self.reason})"
        return f"{self.name}: refused ({self.reason}); {self.how_to_grant}"


def prepare_process(fifo_priority: int) -> list[Privilege]:
    """Ask for FIFO scheduling, locked memory and fine timers; freeze the garbage collector.

    Acts on the calling thread, which must be the one that runs the loop, and comes before the
    loop starts (locking takes tens of milliseconds). A refusal is reported, never raised.
    """
    _touch_linear_algebra()
    asked = [_fifo(fifo_priority), _lock_memory(), _timer_slack()]
    gc.collect()
    gc.freeze()
    gc.disable()
    return asked


def _touch_linear_algebra() -> None:
    """Make BLAS take its work memory now: with locked pages that takes 80 ms, once."""
    square = np.ones((8, 8))
    np.linalg.solve(square @ square + np.eye(8), square)


def _fifo(priority: int) -> Privilege:
    how = "setcap cap_sys_nice+ep on the interpreter, or LimitRTPRIO= in the service"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except OSError as error:
        return Privilege(
            "SCHED_FIFO", granted=False, reason=error.strerror or str(error), how_to_grant=how
        )
    return Privilege("SCHED_FIFO", granted=True, reason=f"priority {priority}", how_to_grant=how)


def _lock_memory() -> Privilege:
    how = "LimitMEMLOCK=infinity in the service, or ulimit -l unlimited"
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE):
        return Privilege(
            "mlockall", granted=False, reason=os.strerror(ctypes.get_errno()), how_to_grant=how
        )
    return Privilege("mlockall", granted=True, reason="all pages locked", how_to_grant=how)


def _timer_slack() -> Privilege:
    granted = False
    with contextlib.suppress(AttributeError):
        granted = ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0) == 0
    return Privilege("timer slack 1 ns", granted, "prctl", "use Linux")
