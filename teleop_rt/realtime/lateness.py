"""Lateness of a loop, in which its drive follows old orders, and the rig's bounds on it.

A stall lasts from the first deadline that passed without its tick to the start of the tick that
ran at last. It is dangerous for as long as the drive moves on old orders, so the bounds are times.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.realtime import LateConfig
from teleop_rt.kernels.jit import bound, kernel, shared

Counts = NDArray[np.int64]

ON_HARDWARE = LateConfig()
"""The default bounds of a rig."""


class Late(IntEnum):
    """Reaction to lateness; the strongest wins."""

    IN_TIME = 0
    HOLD = 1
    STOP = 2


# By these names a tick finds them at once: in Python 3.11 each look-up in an enum is a call.
IN_TIME, LATE_STOP = Late.IN_TIME, Late.STOP
_IN_TIME, _HOLD, _STOP = range(3)  # for kernels, which know numbers alone


# A record of lateness: bounds, counts, and from NEWEST on the newest late ticks.
(
    HOLD_NS,
    STOP_NS,
    PERIOD_NS,
    SECOND,
    TICKS,
    LONGEST_NS,
    HOLDS,
    LATE_TICKS,
    OLDEST,
    STOPPED_AFTER,
    STALL_NS,
    NEWEST,
) = range(12)
_KIND_OF = tuple(Late)


@kernel
def note_skipped(record: Counts, skipped: int) -> None:
    """Note deadlines that passed without a tick: hardly ever."""
    enough = len(record) - NEWEST
    for tick in range(max(0, skipped - enough) + 1, skipped + 1):
        record[NEWEST + record[OLDEST]] = record[TICKS] + tick
        record[OLDEST] = (record[OLDEST] + 1) % enough
    record[LATE_TICKS] += skipped


@kernel
def judge_lateness(record: Counts, late_ns: int) -> int:
    """Take how late a tick began; return the reaction: see `Lateness.update`."""
    skipped = late_ns // record[PERIOD_NS]
    if skipped > 0:
        note_skipped(record, skipped)
    record[TICKS] += 1 + skipped
    record[LONGEST_NS] = max(record[LONGEST_NS], late_ns)
    if late_ns >= record[HOLD_NS]:
        record[HOLDS] += 1
    too_many = record[TICKS] - record[NEWEST + record[OLDEST]] < record[SECOND]
    if late_ns >= record[STOP_NS] or too_many:
        if record[STOPPED_AFTER] < 0:
            record[STOPPED_AFTER], record[STALL_NS] = record[TICKS], late_ns
        return _STOP
    return _HOLD if late_ns >= record[HOLD_NS] else _IN_TIME


def load_kernels() -> None:
    """Compile or load the kernels of a `Lateness`, so that its first tick does not wait."""
    Lateness(ON_HARDWARE, 1_000_000).update(0)


class Lateness:
    """Judges each tick by its own stall, and by the share of the last second that was late.

    `longest_ns` is the longest stall; `holds` counts those from `hold_ms` on; `late_ticks` counts
    the deadlines that passed without a tick. A `reset` forgets only the last second. `record` is
    for kernels.
    """

    def __init__(self, bounds: LateConfig, period_ns: int) -> None:
        self._bounds = bounds
        second = round(1e9 / period_ns)
        # Rounded first: 0.07 of 100 ticks is 7.000000000000001 of them.
        enough = max(1, math.ceil(round(bounds.stop_share * second, 6)))
        self.record = np.zeros(NEWEST + enough, dtype=np.int64)
        self.record[HOLD_NS] = round(bounds.hold_ms * 1e6)
        self.record[STOP_NS] = round(bounds.stop_ms * 1e6)
        self.record[PERIOD_NS], self.record[SECOND] = period_ns, second
        self.record[STOPPED_AFTER] = -1
        self.reset()

    def reset(self) -> None:
        """Forget the last second."""
        self.record[OLDEST] = 0
        self.record[NEWEST:] = self.record[TICKS] - self.record[SECOND]

    def update(self, late_ns: int) -> Late:
        """Take how late this tick began, 0 for one in time; whole periods of it are late ticks."""
        return _KIND_OF[self._judge(late_ns)]

    @cached_property
    def _judge(self) -> Callable[[int], int]:
        return bound(judge_lateness, (self.record,), 0)  # a slave has its own kernel do it

    @property
    def longest_ns(self) -> int:
        """The longest stall."""
        return self.record.item(LONGEST_NS)

    @property
    def holds(self) -> int:
        """How many stalls were long enough to hold."""
        return self.record.item(HOLDS)

    @property
    def late_ticks(self) -> int:
        """How many deadlines passed without a tick."""
        return self.record.item(LATE_TICKS)

    @property
    def stopped(self) -> bool:
        """Whether it has asked for a stop."""
        return self.record.item(STOPPED_AFTER) >= 0

    def outcome(self) -> dict[str, Any]:
        """Return the bounds and the worst values, for the summary; time under power [s]."""
        stop = None
        if self.stopped:
            stall_ns, after = self.record.item(STALL_NS), self.record.item(STOPPED_AFTER)
            stall_ms = stall_ns * 1e-6
            by_stall = stall_ns >= self.record.item(STOP_NS)
            stop = {
                "after_s": after * self.record.item(PERIOD_NS) * 1e-9,
                "bound": "stop_ms" if by_stall else "stop_share",
                "stall_ms": stall_ms,
            }
        return {
            "bounds": self._bounds.model_dump(),
            "longest_stall_ms": self.longest_ns * 1e-6,
            "late_ticks": self.late_ticks,
            "holds": self.holds,
            "stop": stop,
        }


@shared
def late_ns(skipped: int, wake_latency_ns: int, period_ns: int) -> int:
    """Return how late a tick began: the skipped ticks before it, and its own late wake-up.

    A wake-up that is late by whole periods is in `skipped` already.
    """
    return skipped * period_ns + max(0, wake_latency_ns) % period_ns
