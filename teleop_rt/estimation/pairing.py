"""Pairs of position and force from sensors that are slower than the loop.

The position of a new force is that of the time it belongs to, its stamp less its calibrated lag,
by interpolation between the positions around it. Held values would meet moving positions.
A converter that averages the force over its settling time meets the position averaged alike: else
a force that swings is found smaller than it is, and stiffness with it.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
Flags = NDArray[np.bool_]

CUTOFF_SHARE = 0.125
"""Largest cut-off of the differentiator over the rate of the pairs: 8 samples a period."""


MOST_WAITING = 8
"""Forces that wait for the positions of their times; those of a servo come a cycle later."""


MOST_BEHIND = 3
"""Periods by which even pairs may be behind the newest values; what is older is left out."""
LARGEST_GAP_PERIODS = 3
"""Between two forces that are interpolated."""
TAPS = 12
"""Points at which a position is averaged in each conversion."""


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

    def __init__(
        self, loop_period_ns: int, pair_period_ns: int, lag_s: float, settling_s: float = 0.0
    ) -> None:
        self._lag_ns = round(1e9 * lag_s)
        self._period_ns = pair_period_ns
        self._filter = None
        self._half_ns = 0
        if settling_s > 0.0:
            settling_ns = round(1e9 * settling_s)
            self._filter = settling_filter(settling_ns, pair_period_ns)
            self._half_ns = settling_ns // 2
        # A force waits for positions of its time at most one period, and is that much older.
        span_ns = abs(self._lag_ns) + 2 * (pair_period_ns + self._half_ns)
        size = math.ceil(span_ns / loop_period_ns) + 2 + MOST_BEHIND
        self._stamps = [0] * size
        self._positions = [0.0] * size
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._newest, self._count = -1, 0
        self._force_ns = self._last_ns = -1
        self._waiting: deque[tuple[int, float]] = deque(maxlen=MOST_WAITING)
        self.position = self.force = 0.0
        self.gap = 0

    def take(self, position: float, position_ns: int, force: float, force_ns: int) -> bool:
        """Take what is valid in a cycle, with its stamps; return whether there is a new pair."""
        self._note_position(position, position_ns)
        waiting = self._waiting
        if force_ns != self._force_ns:
            self._force_ns = force_ns
            waiting.append((force_ns - self._lag_ns, force))
        if not waiting or waiting[0][0] + self._half_ns > self._stamps[self._newest]:
            return False
        if self._filter is not None:
            return self._meet_averaged(*waiting.popleft(), *self._filter)
        return self._meet(*waiting.popleft())

    def _note_position(self, position: float, position_ns: int) -> None:
        size = len(self._stamps)
        if self._count == 0 or position_ns > self._stamps[self._newest]:
            self._newest = (self._newest + 1) % size
            self._stamps[self._newest], self._positions[self._newest] = position_ns, position
            self._count = min(self._count + 1, size)

    def _meet(self, wanted_ns: int, force: float) -> bool:
        """Interpolate the position of a time; return false where it is older than all kept."""
        size, later = len(self._stamps), self._newest
        for back in range(1, self._count):
            earlier = (self._newest - back) % size
            if self._stamps[earlier] <= wanted_ns:
                span = self._stamps[later] - self._stamps[earlier]
                share = (wanted_ns - self._stamps[earlier]) / span
                before, after = self._positions[earlier], self._positions[later]
                self.position, self.force = before + share * (after - before), force
                self._count_lost(wanted_ns)
                return True
            later = earlier
        return False

    def _meet_averaged(self, wanted_ns: int, force: float, times: Vector, weights: Vector) -> bool:
        """Average the positions about a time; return false where it began before all kept."""
        size, newest = len(self._stamps), self._newest
        order = [(newest - back) % size for back in range(self._count - 1, -1, -1)]
        oldest_ns = self._stamps[order[0]]
        if wanted_ns - self._half_ns < oldest_ns:
            return False
        stamps = np.array([self._stamps[at] - oldest_ns for at in order], dtype=np.float64)
        positions = np.array([self._positions[at] for at in order])
        around = np.interp(times + (wanted_ns - oldest_ns), stamps, positions)
        self.position, self.force = float(weights @ around), force
        self._count_lost(wanted_ns)
        return True

    def _count_lost(self, stamp_ns: int) -> None:
        """Set `gap` by the time since the last pair: whole periods beyond the first are lost."""
        self.gap = 0
        if self._last_ns >= 0:
            self.gap = max(0, round((stamp_ns - self._last_ns) / self._period_ns) - 1)
        self._last_ns = stamp_ns

    @property
    def stamp_ns(self) -> int:
        """Time to which the newest pair belongs."""
        return self._last_ns


class EvenPairing(Pairing):
    """Pairs sensors as fast as the loop, each on its own clock, at evenly spaced times.

    Of such a force some frames are overwritten within a cycle and others wait for the next: both
    it and the position are interpolated at times one period apart.
    """

    def reset(self) -> None:
        """Forget everything."""
        super().reset()
        self._next_ns = -1

    def take(self, position: float, position_ns: int, force: float, force_ns: int) -> bool:
        """Take what is valid in a cycle, with its stamps; return whether there is a new pair."""
        self._note_position(position, position_ns)
        forces = self._waiting
        if not forces or force_ns - self._lag_ns > forces[-1][0]:
            forces.append((force_ns - self._lag_ns, force))
        newest_ns = min(self._stamps[self._newest], forces[-1][0])
        if self._next_ns < 0:
            self._next_ns = newest_ns + self._period_ns
        behind = (newest_ns - self._next_ns) // self._period_ns
        if behind < 0:
            return False
        if behind > MOST_BEHIND:
            self._next_ns += (behind - 1) * self._period_ns
        wanted_ns = self._next_ns
        self._next_ns += self._period_ns
        while len(forces) > 2 and forces[1][0] <= wanted_ns:
            forces.popleft()
        if len(forces) < 2 or forces[0][0] > wanted_ns:
            return False
        (before_ns, before), (after_ns, after) = forces[0], forces[1]
        if after_ns - before_ns > LARGEST_GAP_PERIODS * self._period_ns:
            return False
        share = (wanted_ns - before_ns) / (after_ns - before_ns)
        return self._meet(wanted_ns, before + share * (after - before))


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
