"""Where samples lie on the grid of sampling periods: a stalled loop leaves places without one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.jit import kernel

EARLY_SHARE = 0.25
"""Share of a period by which a stamp may lie before its place: jitter of stamps is no gap."""

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]
Whole = NDArray[np.int64]

_FIRST_NS, _PLACE, _PERIOD_NS, _SLACK_NS = range(4)
"""Words of a grid: where it begins, negative before the first sample, and the newest place."""


@kernel
def gap_before(grid: Whole, stamp_ns: int) -> int:
    """Return how many places lie empty before the sample of this stamp, which fills the next.

    A sample that is stamped before its place moves the grid's phase.
    """
    if grid[_FIRST_NS] < 0:
        grid[_FIRST_NS], grid[_PLACE] = stamp_ns, 0
        return 0
    due = (stamp_ns - grid[_FIRST_NS] + grid[_SLACK_NS]) // grid[_PERIOD_NS]
    grid[_PLACE] += 1
    gap = due - grid[_PLACE]
    if gap > 0:
        grid[_PLACE] = due
        return int(gap)
    grid[_FIRST_NS] = min(grid[_FIRST_NS], stamp_ns - grid[_PLACE] * grid[_PERIOD_NS])
    return 0


@kernel
def gap_at(grid: Whole, valid: bool, stamp_ns: int) -> int:
    """Return how many places lie empty before a cycle; without a valid sample it fills its own."""
    if valid:
        return gap_before(grid, stamp_ns)
    grid[_PLACE] += 1
    return 0


@kernel
def find_places(grid: Whole, valid: Flags, stamp_ns: Vector, places: Whole) -> None:
    """Write the place of each cycle of a recording (cycles,), the first at 0."""
    place = -1
    for index in range(len(places)):
        place += 1
        stamp = int(stamp_ns[index]) if valid[index] else 0
        places[index] = place = place + gap_at(grid, valid[index], stamp)


class SampleGrid:
    """Counts the places between two samples that no cycle filled.

    Stamps lie on the grid of the loop's deadlines, later by their latency: the phase is that of
    the earliest so far. `words` are what kernels work on.
    """

    def __init__(self, period_ns: int) -> None:
        self.words = np.array([-1, 0, period_ns, round(EARLY_SHARE * period_ns)], np.int64)


def with_gaps(
    position: Vector, force: Vector, valid: Flags, stamp_ns: Vector, period_ns: int
) -> tuple[Vector, Vector, Flags]:
    """Return a recording with a missing sample at each place that a stall left empty.

    position, force, valid, stamp_ns (cycles,); longer by the gaps, else as they are.
    """
    stamps = stamp_ns[valid]
    if stamps.size == 0 or np.max(np.diff(stamps), initial=0.0) < (2 - EARLY_SHARE) * period_ns:
        return position, force, valid
    del stamps
    places = np.empty(len(position), np.int64)
    find_places(SampleGrid(period_ns).words, valid, stamp_ns, places)
    size = int(places[-1]) + 1
    filled = np.zeros(size, dtype=np.bool_)
    filled[places] = valid
    return _spread(position, places, size), _spread(force, places, size), filled


def _spread(row: Vector, places: Whole, size: int) -> Vector:
    """Return a row with each value at its place, and not-a-number at others."""
    spread = np.full(size, np.nan)
    spread[places] = row
    return spread
