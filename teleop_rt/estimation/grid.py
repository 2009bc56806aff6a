"""Where samples lie on the grid of sampling periods: a stalled loop leaves places without one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

EARLY_SHARE = 0.25
"""Share of a period by which a stamp may lie before its place: jitter of stamps is no gap."""

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]


class SampleGrid:
    """Counts the places between two samples that no cycle filled.

    Stamps lie on the grid of the loop's deadlines, later by their latency: the phase is that of
    the earliest so far.
    """

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._slack_ns = round(EARLY_SHARE * period_ns)
        self.reset()

    def reset(self) -> None:
        """Start again with the next sample."""
        self._first_ns = -1
        self._place = 0

    def passed(self) -> None:
        """Note a cycle without a valid sample: it fills its place as missing."""
        self._place += 1

    def gap(self, stamp_ns: int) -> int:
        """Return how many places lie empty before the sample of this stamp, which fills the next.

        A sample that is stamped before its place moves the grid's phase.
        """
        if self._first_ns < 0:
            self._first_ns, self._place = stamp_ns, 0
            return 0
        due = (stamp_ns - self._first_ns + self._slack_ns) // self._period_ns
        self._place += 1
        if due <= self._place:
            self._first_ns = min(self._first_ns, stamp_ns - self._place * self._period_ns)
            return 0
        gap = due - self._place
        self._place = due
        return gap


def with_gaps(
    position: Vector, force: Vector, valid: Flags, stamp_ns: Vector, period_ns: int
) -> tuple[Vector, Vector, Flags]:
    """Return a recording with a missing sample at each place that a stall left empty.

    position, force, valid, stamp_ns (cycles,); longer by the gaps, else as they are.
    """
    stamps = stamp_ns[valid]
    if stamps.size == 0 or np.max(np.diff(stamps), initial=0.0) < (2 - EARLY_SHARE) * period_ns:
        return position, force, valid
    grid, place = SampleGrid(period_ns), np.ones(len(position), dtype=np.int64)
    place[0] = 0
    for index in range(len(position)):
        if valid[index]:
            place[index] += grid.gap(int(stamp_ns[index]))
        else:
            grid.passed()
    np.cumsum(place, out=place)
    size = int(place[-1]) + 1
    filled = np.zeros(size, dtype=np.bool_)
    filled[place] = valid
    wide = np.full((2, size), np.nan)
    wide[:, place] = position, force
    return wide[0], wide[1], filled
