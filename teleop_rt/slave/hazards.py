"""One hazard, one small guard: each looks at one thing and says whether to hold or to stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum

from teleop_rt.kernels.jit import kernel

HOLD_AFTER_MS, STOP_AFTER_MS = 3.0, 20.0
"""Time without a usable sample after which the axis holds, and stops."""
LEAST_HOLD_CYCLES = 3
"""A lost answer costs two cycles on CANopen, and is nothing to hold for."""


class Demand(IntEnum):
    """A guard's demand; the strongest wins."""

    NONE = 0
    HOLD = 1
    STOP = 2


_NONE, _HOLD, _STOP = range(3)  # for kernels, which know numbers alone


@dataclass(frozen=True, slots=True)
class Patience:
    """Cycles without a usable sample after which the axis holds, and stops."""

    hold: int
    stop: int

    @classmethod
    def at(cls, rate_hz: int, stop_ms: float = STOP_AFTER_MS) -> Patience:
        """Return them for a rate; `stop_ms` may be longer than STOP_AFTER_MS, not shorter."""
        hold = max(LEAST_HOLD_CYCLES, math.ceil(HOLD_AFTER_MS * 1e-3 * rate_hz))
        stop = math.ceil(max(STOP_AFTER_MS, stop_ms) * 1e-3 * rate_hz)
        return cls(hold, max(hold + 1, stop))


@kernel
def samples_lost(missing: int, hold: int, stop: int) -> int:
    """Hold, and later stop, where position or force is too old to be used, by `Patience`."""
    if missing >= stop:
        return _STOP
    return _HOLD if missing >= hold else _NONE


@kernel
def force_exceeded(force: float, force_max: float) -> int:
    """Stop where the measured force, pressing or pulling, is not within the rig's limit."""
    return _NONE if abs(force) <= force_max else _STOP


@kernel
def position_exceeded(position: float, lowest: float, highest: float, homed: bool) -> int:
    """Stop where the measured position is outside the range by more than 5 % of it.

    Of an axis that is not `homed` yet it must be a number, no more.
    """
    if not homed:
        return _NONE if math.isfinite(position) else _STOP
    margin = 0.05 * (highest - lowest)
    return _NONE if lowest - margin <= position <= highest + margin else _STOP
