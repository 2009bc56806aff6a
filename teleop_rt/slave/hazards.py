"""One hazard, one small guard: each looks at one thing and says whether to hold or to stop."""

from __future__ import annotations

from enum import IntEnum

from teleop_rt.axis import Sample
from teleop_rt.config_rig import Limits

HOLD_AFTER_MISSING = 3
STOP_AFTER_MISSING = 20


class Demand(IntEnum):
    """What a guard asks for; the strongest wins."""

    NONE = 0
    HOLD = 1
    STOP = 2


# As in `faults`: a tick finds them at once.
NONE, HOLD, STOP = Demand


def samples_lost(sample: Sample, stop_after: int = STOP_AFTER_MISSING) -> Demand:
    """Hold after 3 cycles without a valid sample, stop after 20 or more."""
    if sample.missing >= stop_after:
        return STOP
    return HOLD if sample.missing >= HOLD_AFTER_MISSING else NONE


def force_exceeded(sample: Sample, limits: Limits) -> Demand:
    """Stop where the measured force, pressing or pulling, is not within the rig's limit."""
    return NONE if abs(sample.force) <= limits.force_max else STOP


def position_exceeded(sample: Sample, limits: Limits) -> Demand:
    """Stop where the measured position is outside the range by more than 5 % of it."""
    margin = 0.05 * (limits.position_max - limits.position_min)
    outside = not limits.position_min - margin <= sample.position <= limits.position_max + margin
    return STOP if outside else NONE
