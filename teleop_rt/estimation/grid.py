"""Where samples lie on the grid of sampling periods: a stalled loop leaves places without one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel

EARLY_SHARE = 0.25
"""Share of a period by which a stamp may lie before its place: jitter of stamps is no gap."""

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]
Whole = NDArray[np.int64]
Row = TypeVar("Row", Vector, Flags)

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
def longest_step(valid: Flags, stamp_ns: Vector) -> float:
    """Return the longest time between two samples that follow each other [ns]."""
    longest, last = 0.0, math.nan
    for index in range(len(valid)):
        if valid[index]:
            longest = max(longest, stamp_ns[index] - last)
            last = stamp_ns[index]
    return longest


@kernel
def next_place(grid: Whole, valid: Flags, stamp_ns: Vector, index: int, place: int) -> int:
    """Return the place of a cycle of a recording, which comes after the cycle at `place`."""
    stamp = int(stamp_ns[index]) if valid[index] else 0
    return place + 1 + gap_at(grid, valid[index], stamp)


@kernel
def count_places(grid: Whole, valid: Flags, stamp_ns: Vector) -> int:
    """Return how many places a recording has from its first cycle to its last."""
    place = -1
    for index in range(len(valid)):
        place = next_place(grid, valid, stamp_ns, index, place)
    return place + 1


@kernel
def spread_row(grid: Whole, valid: Flags, stamp_ns: Vector, row: Row, spread: Row) -> None:
    """Write each value of a recording's row (cycles,) at its place in `spread` (places,)."""
    place = -1
    for index in range(len(valid)):
        place = next_place(grid, valid, stamp_ns, index, place)
        spread[place] = row[index]


class SampleGrid:
    """Counts the places between two samples that no cycle filled.

    Stamps lie on the grid of the loop's deadlines, later by their latency: the phase is that of
    the earliest so far. `words` are the arrays of the kernels.
    """

    def __init__(self, period_ns: int) -> None:
        self.words = np.array([-1, 0, period_ns, round(EARLY_SHARE * period_ns)], np.int64)


def with_gaps(rows: Iterable[Row], valid: Flags, stamp_ns: Vector, period_ns: int) -> Iterator[Row]:
    """Yield rows of a recording with a missing sample at each place that a stall left empty.

    rows, valid, stamp_ns (cycles,); longer by the gaps, else as they are. A missing number is none,
    a missing flag is false. A row is asked for when the one before is done: an hour's takes 29 MB.
    """
    if longest_step(valid, stamp_ns) < (2 - EARLY_SHARE) * period_ns:
        yield from rows
        return
    size = count_places(SampleGrid(period_ns).words, valid, stamp_ns)
    for row in rows:
        spread = np.full(size, False if row.dtype == np.bool_ else np.nan, row.dtype)
        spread_row(SampleGrid(period_ns).words, valid, stamp_ns, row, spread)
        yield cast("Row", spread)
