"""How long a loop left its drive on old orders, and what the rig's bounds ask for then.

A stall lasts from the first deadline that passed without its tick to the start of the tick that
ran at last. It is dangerous for as long as the drive moves on old orders, so the bounds are times.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

from teleop_rt.config_rig import LateConfig

ON_HARDWARE = LateConfig()
"""The default bounds of a rig."""


class Late(IntEnum):
    """Reaction to lateness; the strongest wins."""

    IN_TIME = 0
    HOLD = 1
    STOP = 2


# By these names a tick finds them at once: in Python 3.11 each look-up in an enum is a call.
IN_TIME, HOLD, STOP = Late


class Lateness:
    """Judges each tick by its own stall, and by the share of the last second that was late.

    `longest_ns` is the longest stall; `holds` counts those from `hold_ms` on; `late_ticks` counts
    the deadlines that passed without a tick. What a `reset` forgets is the last second alone.
    """

    def __init__(self, bounds: LateConfig, period_ns: int) -> None:
        self._bounds = bounds
        self._period_ns = period_ns
        self._hold_ns, self._stop_ns = round(bounds.hold_ms * 1e6), round(bounds.stop_ms * 1e6)
        self._second = round(1e9 / period_ns)
        # Rounded first: 0.07 of 100 ticks is 7.000000000000001 of them.
        enough = max(1, math.ceil(round(bounds.stop_share * self._second, 6)))
        self._newest = [0] * enough
        self.longest_ns = self.holds = self.late_ticks = self._ticks = 0
        self._stopped_after = -1
        self._stall_ns = 0
        self.reset()

    def reset(self) -> None:
        """Forget the last second."""
        self._oldest = 0
        for index in range(len(self._newest)):
            self._newest[index] = self._ticks - self._second

    def update(self, late_ns: int) -> Late:
        """Take how late this tick began, 0 for one in time; whole periods of it are late ticks."""
        skipped = late_ns // self._period_ns
        if skipped:  # hardly ever
            self._note_skipped(skipped)
        self._ticks += 1 + skipped
        if late_ns > self.longest_ns:  # noqa: PLR1730 - in every tick, where max() costs more
            self.longest_ns = late_ns
        long = late_ns >= self._hold_ns
        self.holds += long
        if late_ns >= self._stop_ns or self._ticks - self._newest[self._oldest] < self._second:
            if self._stopped_after < 0:
                self._stopped_after, self._stall_ns = self._ticks, late_ns
            return STOP
        return HOLD if long else IN_TIME

    def _note_skipped(self, skipped: int) -> None:
        newest, enough = self._newest, len(self._newest)
        for tick in range(max(0, skipped - enough) + 1, skipped + 1):
            newest[self._oldest] = self._ticks + tick
            self._oldest = (self._oldest + 1) % enough
        self.late_ticks += skipped

    @property
    def stopped(self) -> bool:
        """Whether it has asked for a stop."""
        return self._stopped_after >= 0

    def outcome(self) -> dict[str, Any]:
        """Return the bounds and what they came to, for the summary; time under power [s]."""
        stop = None
        if self.stopped:
            stall_ms = self._stall_ns * 1e-6
            by_stall = self._stall_ns >= self._stop_ns
            stop = {
                "after_s": self._stopped_after * self._period_ns * 1e-9,
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


def late_ns(skipped: int, wake_latency_ns: int, period_ns: int) -> int:
    """Return how late a tick began: the ticks skipped before it, and what it woke up after its own.

    A wake-up that is late by whole periods is in `skipped` already.
    """
    return skipped * period_ns + max(0, wake_latency_ns) % period_ns
