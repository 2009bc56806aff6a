"""Pairs of position and force from sensors that are slower than the loop.

The position of a new force is that of the time it belongs to, its stamp less its calibrated lag,
by interpolation between the positions around it. Held values would meet moving positions.
A converter that averages the force over its settling time meets the position averaged alike: else
a force that swings is found smaller than it is, and stiffness with it.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import StoredSample
from teleop_rt.estimation.pair_kernels import (
    MOST_BEHIND,
    PAIR,
    PAIRS_TYPE,
    TO_AVERAGE,
    Paired,
    Pairs,
    StoredPairs,
    Vector,
    count_lost,
    place,
    take_values,
)
from teleop_rt.kernels.jit import bound

Flags = NDArray[np.bool_]

CUTOFF_SHARE = 0.125
"""Largest cut-off of the differentiator over the rate of the pairs: 8 samples a period."""


MOST_WAITING = 8
"""Forces that wait for the positions of their times; those of a servo come a cycle later."""


TAPS = 12
"""Points at which a position is averaged in each conversion."""
_LAST, _GAP, _POSITION, _FORCE = map(place, ("last_ns", "gap", "position", "force"))


def settling_filter(settling_ns: int, conversion_ns: int) -> tuple[Vector, Vector]:
    """Return times about the middle [ns] and weights (n,) of a converter that so settles.

    It averages once for each conversion that it takes to settle, as a sinc filter of that order
    does (Candy, Temes: Oversampling Delta-Sigma Data Converters, 1992).
    """
    order = max(1, round(settling_ns / conversion_ns))
    average = np.full(TAPS, 1.0 / TAPS)
    weights: Vector = np.ones(1)
    for _ in range(order):
        weights = np.convolve(weights, average)
    steps = np.arange(len(weights), dtype=np.float64) - (len(weights) - 1) / 2.0
    return steps * (settling_ns / order / TAPS), weights


class Pairing:
    """Keeps the newest positions, and meets each new force with the one that it belongs to.

    `position` and `force` are the newest pair, in rig units, `gap` how many pairs were lost before
    it. Nothing is allocated after the start but for a converter that settles in `settling_s`.
    """

    _is_even = False

    def __init__(
        self, loop_period_ns: int, pair_period_ns: int, lag_s: float, settling_s: float = 0.0
    ) -> None:
        stored: StoredPairs = np.zeros(1, PAIRS_TYPE)
        self._pairs = pairs = cast("Pairs", stored[0])
        pairs.lag_ns, pairs.period_ns = round(1e9 * lag_s), pair_period_ns
        pairs.is_even = self._is_even
        self._filter = None
        if settling_s > 0.0:
            settling_ns = round(1e9 * settling_s)
            self._filter = settling_filter(settling_ns, pair_period_ns)
            pairs.half_ns, pairs.averages = settling_ns // 2, 1
        # A force waits for positions of its time at most one period, and is that much older.
        span_ns = abs(pairs.lag_ns) + 2 * (pair_period_ns + pairs.half_ns)
        size = math.ceil(span_ns / loop_period_ns) + 2 + MOST_BEHIND
        self._stamps, self._positions = np.zeros(size, np.int64), np.zeros(size)
        words = stored.view(np.uint8).data
        self._floats, self._counts = words.cast("d"), words.cast("q")
        waiting = np.zeros(MOST_WAITING, np.int64), np.zeros(MOST_WAITING)
        self._arrays = stored, self._stamps, self._positions, *waiting
        self._take = bound(take_values, self._arrays, 0.0, 0, 0.0, 0)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        pairs = self._pairs
        pairs.count = pairs.waiting = pairs.gap = 0
        pairs.newest = pairs.force_ns = pairs.next_ns = pairs.last_ns = -1
        pairs.position = pairs.force = 0.0

    def take(self, position: float, position_ns: int, force: float, force_ns: int) -> bool:
        """Take a cycle's valid values with their stamps; return whether there is a new pair."""
        found = self._take(position, position_ns, force, force_ns)
        return found == PAIR or (found == TO_AVERAGE and self.average())

    def of(self, stored: StoredSample) -> Paired:
        """Return the arrays with which a kernel pairs a cycle's sample."""
        return Paired(stored, *self._arrays)

    def average(self) -> bool:
        """Average the positions about the time TO_AVERAGE; false where it began before all kept."""
        if self._filter is None:
            return False
        times, weights = self._filter
        pairs, size, wanted_ns = self._pairs, len(self._stamps), int(self._pairs.next_ns)
        order = (int(pairs.newest) - np.arange(int(pairs.count) - 1, -1, -1)) % size
        oldest_ns = int(self._stamps[order[0]])
        if wanted_ns - int(pairs.half_ns) < oldest_ns:
            return False
        stamps = (self._stamps[order] - oldest_ns).astype(np.float64)
        around = np.interp(times + (wanted_ns - oldest_ns), stamps, self._positions[order])
        pairs.position = float(weights @ around)
        count_lost(pairs, wanted_ns)
        return True

    @property
    def averages(self) -> bool:
        """Whether positions are averaged, by `average`."""
        return self._filter is not None

    @property
    def position(self) -> float:
        """Position of the newest pair."""
        return self._floats[_POSITION]

    @property
    def force(self) -> float:
        """Force of the newest pair."""
        return self._floats[_FORCE]

    @property
    def gap(self) -> int:
        """How many pairs were lost before the newest one."""
        return self._counts[_GAP]

    @property
    def stamp_ns(self) -> int:
        """Time to which the newest pair belongs."""
        return self._counts[_LAST]


class EvenPairing(Pairing):
    """Pairs sensors as fast as the loop, each on its own clock, at evenly spaced times.

    Of such a force some frames are overwritten within a cycle and others wait for the next: both
    it and the position are interpolated at times one period apart.
    """

    _is_even = True


def pairs_of(
    pairing: Pairing,
    position: Vector,
    position_ns: NDArray[np.int64],
    force: Vector,
    force_ns: NDArray[np.int64],
    valid: Flags,
) -> tuple[Vector, Vector, Flags, Vector]:
    """Return the pairs of a recording as it ran: position, force, flags and stamps [ns] (pairs,).

    position, force, stamps and valid (cycles,). A lost pair is one that is not flagged.
    """
    pairing.reset()
    kept: list[tuple[float, float, bool, float]] = []
    columns = (position, position_ns, force, force_ns, valid)
    for x, x_ns, f, f_ns, good in zip(*(column.tolist() for column in columns), strict=True):
        if good and pairing.take(x, x_ns, f, f_ns):
            kept += [(math.nan, math.nan, False, math.nan)] * pairing.gap
            kept.append((pairing.position, pairing.force, True, float(pairing.stamp_ns)))
    table = np.array(kept, dtype=np.float64).reshape(-1, 4)
    return table[:, 0].copy(), table[:, 1].copy(), table[:, 2] > 0, table[:, 3].copy()
