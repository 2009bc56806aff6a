"""Pairs of position and force as kernels: a cycle's values are kept, and meet where they belong."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type

if TYPE_CHECKING:
    from teleop_rt.axis import StoredSample

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
    p: Pairs,
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
    p: Pairs,
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
    p: Any = stored[0]
    if p.is_even > 0:
        return take_even(
            p, stamps, positions, times, forces, position, position_ns, force, force_ns
        )
    return take_next(p, stamps, positions, times, forces, position, position_ns, force, force_ns)


@kernel
def take_sample(
    samples: StoredSample,
    stored: StoredPairs,
    stamps: Counts,
    positions: Vector,
    times: Counts,
    forces: Vector,
    ready: bool,
) -> int:
    """Take a cycle's sample as `take_values` does, valid only where it is ready, too."""
    s: Any = samples[0]
    if not ready or s.valid == 0:
        return NOTHING
    return take_values(
        stored, stamps, positions, times, forces, s.position, s.position_stamp_ns, s.force,
        s.force_stamp_ns,
    )  # fmt: skip
