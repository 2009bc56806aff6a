"""One hazard, one small guard: each looks at one thing and says whether to hold or to stop."""

from __future__ import annotations

from enum import IntEnum

from teleop_rt.axis import Sample
from teleop_rt.config import Limits

HOLD_AFTER_MISSING = 3
STOP_AFTER_MISSING = 20
LATE_IN_A_ROW = 5
LATE_IN_A_SECOND = 20


class Demand(IntEnum):
    """What a guard asks for; the strongest wins."""

    NONE = 0
    HOLD = 1
    STOP = 2


def samples_lost(sample: Sample) -> Demand:
    """Hold after 3 cycles without a valid sample, stop after 20."""
    if sample.missing >= STOP_AFTER_MISSING:
        return Demand.STOP
    return Demand.HOLD if sample.missing >= HOLD_AFTER_MISSING else Demand.NONE


def force_exceeded(sample: Sample, limits: Limits) -> Demand:
    """Stop where the measured force, pressing or pulling, is above the rig's limit."""
    return Demand.STOP if abs(sample.force) > limits.force_max else Demand.NONE


def position_exceeded(sample: Sample, limits: Limits) -> Demand:
    """Stop where the measured position is outside the range by more than 5 % of it."""
    margin = 0.05 * (limits.position_max - limits.position_min)
    outside = not limits.position_min - margin <= sample.position <= limits.position_max + margin
    return Demand.STOP if outside else Demand.NONE


class LateTicks:
    """Stop after 5 late ticks in a row, or 20 within a second.

    The count within a second leaks: it falls by 20 over a second without a late tick.
    """

    def __init__(self, rate_hz: int) -> None:
        self._leak = LATE_IN_A_SECOND / rate_hz
        self.reset()

    def reset(self) -> None:
        """Forget what was late."""
        self._in_a_row = 0
        self._in_a_second = 0.0

    def check(self, skipped: int) -> Demand:
        """Count the ticks skipped before this one."""
        self._in_a_row = self._in_a_row + 1 if skipped else 0
        self._in_a_second = max(0.0, self._in_a_second - self._leak * (1 + skipped)) + skipped
        late = skipped >= LATE_IN_A_ROW or self._in_a_row >= LATE_IN_A_ROW
        return Demand.STOP if late or self._in_a_second > LATE_IN_A_SECOND else Demand.NONE
