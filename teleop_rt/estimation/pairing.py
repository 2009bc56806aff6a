"""Pairs of position and force from sensors that are slower than the loop.

The position of a new force is that of the time it belongs to, its stamp less its calibrated lag,
by interpolation between the positions around it. Held values would meet moving positions.
A converter that averages the force over its settling time meets the position averaged alike: else
a force that swings is found smaller than it is, and stiffness with it.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.jit import bound, kernel
from teleop_rt.kernel_record import record_type

Vector = NDArray[np.float64]
Counts = NDArray[np.int64]
StoredPairs = NDArray[np.record]
Flags = NDArray[np.bool_]

CUTOFF_SHARE = 0.125
"""Largest cut-off of the differentiator over the rate of the pairs: 8 samples a period."""


MOST_WAITING = 8
"""Forces that wait for the positions of their times; those of a servo come a cycle later."""


MOST_BEHIND = 3
"""Periods by which even pairs may be behind the newest values; what is older is left out."""
LARGEST_GAP_PERIODS = 2.5
"""Between two forces that are interpolated: of two clocks one frame is overwritten, seldom more.

What is missing beyond that is a gap, of which the estimators know."""
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


class Pairs:
    """Fields of what a pairing keeps: settings, its rings' places, and the newest pair.

    `averages` says that the position is averaged by the caller, in `half_ns` about the time.
    """

    lag_ns: int
    period_ns: int
    half_ns: int
    averages: int
    newest: int
    count: int
    oldest: int
    waiting: int
    force_ns: int
    next_ns: int
    last_ns: int
    gap: int
    position: float
    force: float


_PAIRS = record_type(Pairs)
_NAMES = list(Pairs.__annotations__)
_LAST, _GAP, _POSITION, _FORCE = map(_NAMES.index, ("last_ns", "gap", "position", "force"))
NOTHING, PAIR, TO_AVERAGE = range(3)
"""Results of a cycle: no pair, one, or a force whose position the caller averages."""


@kernel
def note_position(
    p: Pairs, stamps: Counts, positions: Vector, position: float, stamp_ns: int
) -> None:
    """Keep a position that is newer than all others."""
    size = len(stamps)
    if p.count == 0 or stamp_ns > stamps[p.newest]:
        p.newest = (p.newest + 1) % size
        stamps[p.newest], positions[p.newest] = stamp_ns, position
        p.count = min(p.count + 1, size)


@kernel
def note_force(p: Pairs, times: Counts, forces: Vector, force: float, time_ns: int) -> None:
    """Let a force wait; of too many the oldest is dropped."""
    size = len(times)
    if p.waiting == size:
        drop_force(p, size)
    at = (p.oldest + p.waiting) % size
    times[at], forces[at] = time_ns, force
    p.waiting += 1


@kernel
def drop_force(p: Pairs, size: int) -> None:
    """Drop the oldest of the forces that wait."""
    p.oldest = (p.oldest + 1) % size
    p.waiting -= 1


@kernel
def count_lost(p: Pairs, stamp_ns: int) -> None:
    """Set `gap` by the time since the last pair: whole periods beyond the first are lost."""
    p.gap = 0
    if p.last_ns >= 0:
        p.gap = max(0, int(np.rint((stamp_ns - p.last_ns) / p.period_ns)) - 1)
    p.last_ns = stamp_ns


@kernel
def meet(p: Pairs, stamps: Counts, positions: Vector, wanted_ns: int, force: float) -> int:
    """Interpolate the position of a time; there is none where it is older than all kept."""
    size, later = len(stamps), p.newest
    for back in range(1, p.count):
        earlier = (p.newest - back) % size
        if stamps[earlier] <= wanted_ns:
            share = (wanted_ns - stamps[earlier]) / (stamps[later] - stamps[earlier])
            before, after = positions[earlier], positions[later]
            p.position, p.force = before + share * (after - before), force
            count_lost(p, wanted_ns)
            return PAIR
        later = earlier
    return NOTHING


@kernel
def take_next(
    stored: StoredPairs,
    stamps: Counts,
    positions: Vector,
    times: Counts,
    forces: Vector,
    position: float,
    position_ns: int,
    force: float,
    force_ns: int,
) -> int:
    """Take what is valid in a cycle; meet the oldest new force once its position is there."""
    p: Any = stored[0]
    note_position(p, stamps, positions, position, position_ns)
    if force_ns != p.force_ns:
        p.force_ns = force_ns
        note_force(p, times, forces, force, force_ns - p.lag_ns)
    if p.waiting == 0 or times[p.oldest] + p.half_ns > stamps[p.newest]:
        return NOTHING
    wanted_ns, met = times[p.oldest], forces[p.oldest]
    drop_force(p, len(times))
    if p.averages > 0:
        p.next_ns, p.force = wanted_ns, met
        return TO_AVERAGE
    return meet(p, stamps, positions, wanted_ns, met)


@kernel
def take_even(
    stored: StoredPairs,
    stamps: Counts,
    positions: Vector,
    times: Counts,
    forces: Vector,
    position: float,
    position_ns: int,
    force: float,
    force_ns: int,
) -> int:
    """Take what is valid in a cycle; meet at the next of evenly spaced times, if it has come."""
    p: Any = stored[0]
    size = len(times)
    note_position(p, stamps, positions, position, position_ns)
    last = (p.oldest + p.waiting - 1) % size
    if p.waiting == 0 or force_ns - p.lag_ns > times[last]:
        note_force(p, times, forces, force, force_ns - p.lag_ns)
        last = (p.oldest + p.waiting - 1) % size
    newest_ns = min(stamps[p.newest], times[last])
    if p.next_ns < 0:
        p.next_ns = newest_ns + p.period_ns
    behind = (newest_ns - p.next_ns) // p.period_ns
    if behind < 0:
        return NOTHING
    if behind > MOST_BEHIND:
        p.next_ns += (behind - 1) * p.period_ns
    wanted_ns = p.next_ns
    p.next_ns += p.period_ns
    while p.waiting > 2 and times[(p.oldest + 1) % size] <= wanted_ns:
        drop_force(p, size)
    at, then = p.oldest, (p.oldest + 1) % size
    if p.waiting < 2 or times[at] > wanted_ns:
        return NOTHING
    if times[then] - times[at] > LARGEST_GAP_PERIODS * p.period_ns:
        return NOTHING
    share = (wanted_ns - times[at]) / (times[then] - times[at])
    met = forces[at] + share * (forces[then] - forces[at])
    return meet(p, stamps, positions, wanted_ns, met)


class Pairing:
    """Keeps the newest positions, and meets each new force with the one that it belongs to.

    `position` and `force` are the newest pair, in rig units, `gap` how many pairs were lost before
    it. Nothing is allocated after the start but for a converter that settles in `settling_s`.
    """

    _taking = staticmethod(take_next)

    def __init__(
        self, loop_period_ns: int, pair_period_ns: int, lag_s: float, settling_s: float = 0.0
    ) -> None:
        stored: StoredPairs = np.zeros(1, _PAIRS)
        self._pairs = pairs = cast("Pairs", stored[0])
        pairs.lag_ns, pairs.period_ns = round(1e9 * lag_s), pair_period_ns
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
        kept = self._stamps, self._positions
        waiting = np.zeros(MOST_WAITING, np.int64), np.zeros(MOST_WAITING)
        self._take = bound(self._taking, (stored, *kept, *waiting), 0.0, 0, 0.0, 0)
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        pairs = self._pairs
        pairs.count = pairs.waiting = pairs.gap = 0
        pairs.newest = pairs.force_ns = pairs.next_ns = pairs.last_ns = -1
        pairs.position = pairs.force = 0.0

    def take(self, position: float, position_ns: int, force: float, force_ns: int) -> bool:
        """Take what is valid in a cycle, with its stamps; return whether there is a new pair."""
        found = self._take(position, position_ns, force, force_ns)
        if found == TO_AVERAGE and self._filter is not None:
            return self._meet_averaged(int(self._pairs.next_ns), *self._filter)
        return found == PAIR

    def _meet_averaged(self, wanted_ns: int, times: Vector, weights: Vector) -> bool:
        """Average the positions about a time; return false where it began before all kept."""
        pairs, size = self._pairs, len(self._stamps)
        order = (int(pairs.newest) - np.arange(int(pairs.count) - 1, -1, -1)) % size
        oldest_ns = int(self._stamps[order[0]])
        if wanted_ns - int(pairs.half_ns) < oldest_ns:
            return False
        stamps = (self._stamps[order] - oldest_ns).astype(np.float64)
        around = np.interp(times + (wanted_ns - oldest_ns), stamps, self._positions[order])
        pairs.position = float(weights @ around)
        count_lost(pairs, wanted_ns)
        return True

    def newest(self) -> tuple[float, float, int]:
        """Return position and force of the newest pair, and how many were lost before it."""
        return self._floats[_POSITION], self._floats[_FORCE], self._counts[_GAP]

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

    _taking = staticmethod(take_even)


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
