"""One hazard, one small guard: each looks at one thing and says whether to hold or to stop."""

from __future__ import annotations

from enum import IntEnum

from teleop_rt.axis import Sample
from teleop_rt.config_rig import Limits

HOLD_AFTER_MISSING = 3
STOP_AFTER_MISSING = 20
LATE_IN_A_ROW = 5
LATE_IN_A_SECOND = 20


class Demand(IntEnum):
    """What a guard asks for; the strongest wins."""

    NONE = 0
    HOLD = 1
    STOP = 2


# As in `faults`: a tick finds them at once.
NONE, HOLD, STOP = Demand


def samples_lost(sample: Sample) -> Demand:
    """Hold after 3 cycles without a valid sample, stop after 20."""
    if sample.missing >= STOP_AFTER_MISSING:
        return STOP
    return HOLD if sample.missing >= HOLD_AFTER_MISSING else NONE


def force_exceeded(sample: Sample, limits: Limits) -> Demand:
    """Stop where the measured force, pressing or pulling, is above the rig's limit."""
    return STOP if abs(sample.force) > limits.force_max else NONE


def position_exceeded(sample: Sample, limits: Limits) -> Demand:
    """Stop where the measured position is outside the range by more than 5 % of it."""
    margin = 0.05 * (limits.position_max - limits.position_min)
    outside = not limits.position_min - margin <= sample.position <= limits.position_max + margin
    return STOP if outside else NONE


class LateTicks:
    """Stop after 5 late ticks in a row, or 20 within a second; a tick skipped is a late tick."""

    def __init__(self, rate_hz: int) -> None:
        self._rate_hz = rate_hz
        self._last = [0] * LATE_IN_A_SECOND
        self.reset()

    def reset(self) -> None:
        """Forget what was late."""
        self._tick = 0
        self._in_a_row = 0
        self._oldest = 0
        for index in range(LATE_IN_A_SECOND):
            self._last[index] = -self._rate_hz

    def check(self, skipped: int) -> Demand:
        """Count the ticks skipped before this one."""
        self._in_a_row = self._in_a_row + 1 if skipped else 0
        for _ in range(min(skipped, LATE_IN_A_SECOND)):
            self._last[self._oldest] = self._tick
            self._oldest = (self._oldest + 1) % LATE_IN_A_SECOND
        self._tick += 1 + skipped
        in_a_row = max(skipped, self._in_a_row) >= LATE_IN_A_ROW
        in_a_second = self._tick - self._last[self._oldest] <= self._rate_hz
        return STOP if in_a_row or in_a_second else NONE
