"""Pairs of position and force as kernels: a cycle's values are kept, and meet where they belong."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import SAMPLE_TYPE, StoredSample
from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type

Vector = NDArray[np.float64]
Counts = NDArray[np.int64]
StoredPairs = NDArray[np.record]

MOST_BEHIND = 3
"""Periods by which even pairs may be behind the newest values; older values are left out."""
LARGEST_GAP_PERIODS = 2.5
"""Between two forces that are interpolated: of two clocks one frame is overwritten, seldom more.

A longer loss is a gap, of which the estimators know."""


class Pairs:
    """Fields of a pairing's record: settings, its rings' places, and the newest pair.

    `averages` says that the position is averaged by the caller, in `half_ns` about the time, and
    `is_even` that the pairs are at evenly spaced times.
    """

    lag_ns: int
    period_ns: int
    half_ns: int
    averages: int
    is_even: int
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


PAIRS_TYPE = record_type(Pairs)
_NAMES = list(Pairs.__annotations__)
NOTHING, PAIR, TO_AVERAGE = range(3)
"""Results of a cycle: no pair, one, or a force whose position the caller averages."""


def place(field: str) -> int:
    """Return where a field is among the words of a pairing."""
    return _NAMES.index(field)


class Paired(NamedTuple):
    """Arrays of a pairing for kernels: the cycle's sample (1,), its record (1,), its rings."""

    samples: StoredSample
    pairs: StoredPairs
    stamps: Counts
    positions: Vector
    times: Counts
    forces: Vector


NO_PAIRS = Paired(
    np.zeros(0, SAMPLE_TYPE), np.zeros(0, PAIRS_TYPE), np.zeros(0, np.int64), np.zeros(0),
    np.zeros(0, np.int64), np.zeros(0),
)  # fmt: skip
"""In place of a pairing: none of it is looked at."""


@kernel
def note_position(
    pairs: Pairs, stamps: Counts, positions: Vector, position: float, stamp_ns: int
) -> None:
    """Keep a position that is newer than all others."""
    size = len(stamps)
    if pairs.count == 0 or stamp_ns > stamps[pairs.newest]:
        pairs.newest = (pairs.newest + 1) % size
        stamps[pairs.newest], positions[pairs.newest] = stamp_ns, position
        pairs.count = min(pairs.count + 1, size)


@kernel
def note_force(pairs: Pairs, times: Counts, forces: Vector, force: float, time_ns: int) -> None:
    """Let a force wait; of too many the oldest is dropped."""
    size = len(times)
    if pairs.waiting == size:
        drop_force(pairs, size)
    at = (pairs.oldest + pairs.waiting) % size
    times[at], forces[at] = time_ns, force
    pairs.waiting += 1


@kernel
def drop_force(pairs: Pairs, size: int) -> None:
    """Drop the oldest of the forces that wait."""
    pairs.oldest = (pairs.oldest + 1) % size
    pairs.waiting -= 1


@kernel
def count_lost(pairs: Pairs, stamp_ns: int) -> None:
    """Set `gap` by the time since the last pair: whole periods beyond the first are lost."""
    pairs.gap = 0
    if pairs.last_ns >= 0:
        pairs.gap = max(0, int(np.rint((stamp_ns - pairs.last_ns) / pairs.period_ns)) - 1)
    pairs.last_ns = stamp_ns


@kernel
def interpolate_position(
    pairs: Pairs, stamps: Counts, positions: Vector, wanted_ns: int, force: float
) -> int:
    """Interpolate the position of a time; there is none where it is older than all kept."""
    size, later = len(stamps), pairs.newest
    for back in range(1, pairs.count):
        earlier = (pairs.newest - back) % size
        if stamps[earlier] <= wanted_ns:
            share = (wanted_ns - stamps[earlier]) / (stamps[later] - stamps[earlier])
            before, after = positions[earlier], positions[later]
            pairs.position, pairs.force = before + share * (after - before), force
            count_lost(pairs, wanted_ns)
            return PAIR
        later = earlier
    return NOTHING


@kernel
def take_next(
    pairs: Pairs,
    stamps: Counts,
    positions: Vector,
    times: Counts,
    forces: Vector,
    position: float,
    position_ns: int,
    force: float,
    force_ns: int,
) -> int:
    """Take a cycle's valid values; pair the oldest new force once its position is there."""
    note_position(pairs, stamps, positions, position, position_ns)
    if force_ns != pairs.force_ns:
        pairs.force_ns = force_ns
        note_force(pairs, times, forces, force, force_ns - pairs.lag_ns)
    if pairs.waiting == 0 or times[pairs.oldest] + pairs.half_ns > stamps[pairs.newest]:
        return NOTHING
    wanted_ns, met = times[pairs.oldest], forces[pairs.oldest]
    drop_force(pairs, len(times))
    if pairs.averages > 0:
        pairs.next_ns, pairs.force = wanted_ns, met
        return TO_AVERAGE
    return interpolate_position(pairs, stamps, positions, wanted_ns, met)


@kernel
def take_even(
    pairs: Pairs,
    stamps: Counts,
    positions: Vector,
    times: Counts,
    forces: Vector,
    position: float,
    position_ns: int,
    force: float,
    force_ns: int,
) -> int:
    """Take a cycle's valid values; pair them at the next of evenly spaced times, if it has come."""
    size = len(times)
    note_position(pairs, stamps, positions, position, position_ns)
    last = (pairs.oldest + pairs.waiting - 1) % size
    if pairs.waiting == 0 or force_ns - pairs.lag_ns > times[last]:
        note_force(pairs, times, forces, force, force_ns - pairs.lag_ns)
        last = (pairs.oldest + pairs.waiting - 1) % size
    newest_ns = min(stamps[pairs.newest], times[last])
    if pairs.next_ns < 0:
        pairs.next_ns = newest_ns + pairs.period_ns
    behind = (newest_ns - pairs.next_ns) // pairs.period_ns
    if behind < 0:
        return NOTHING
    if behind > MOST_BEHIND:
        pairs.next_ns += (behind - 1) * pairs.period_ns
    wanted_ns = pairs.next_ns
    pairs.next_ns += pairs.period_ns
    while pairs.waiting > 2 and times[(pairs.oldest + 1) % size] <= wanted_ns:
        drop_force(pairs, size)
    at, then = pairs.oldest, (pairs.oldest + 1) % size
    if pairs.waiting < 2 or times[at] > wanted_ns:
        return NOTHING
    if times[then] - times[at] > LARGEST_GAP_PERIODS * pairs.period_ns:
        return NOTHING
    share = (wanted_ns - times[at]) / (times[then] - times[at])
    met = forces[at] + share * (forces[then] - forces[at])
    return interpolate_position(pairs, stamps, positions, wanted_ns, met)


@kernel
def take_values(
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
    """Take a cycle's valid values with their stamps; return whether there is a pair."""
    pairs: Any = stored[0]
    if pairs.is_even > 0:
        return take_even(
            pairs, stamps, positions, times, forces, position, position_ns, force, force_ns
        )
    return take_next(
        pairs, stamps, positions, times, forces, position, position_ns, force, force_ns
    )


@kernel
def take_sample(paired: Paired, ready: bool) -> int:
    """Take a cycle's sample as `take_values` does, valid only where it is ready, too."""
    sample: Any = paired.samples[0]
    if not ready or sample.valid == 0:
        return NOTHING
    return take_values(
        paired.pairs, paired.stamps, paired.positions, paired.times, paired.forces,
        sample.position, sample.position_stamp_ns, sample.force, sample.force_stamp_ns,
    )  # fmt: skip
