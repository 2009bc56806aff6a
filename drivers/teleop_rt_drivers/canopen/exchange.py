"""The exchange of a cycle at a door, as kernels: answers in, SYNC out, the command out."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type
from teleop_rt_drivers.can_door import LENGTH_SHIFT, UNUSUAL, put_frame, take_lent
from teleop_rt_drivers.canopen.intake import take_cycle

if TYPE_CHECKING:
    from teleop_rt.axis import StoredSample
    from teleop_rt_drivers.can_door import Doors, Lengths
    from teleop_rt_drivers.can_frames import Slots
    from teleop_rt_drivers.canopen.source import Readings, SourceFields, Sources
    from teleop_rt_drivers.canopen.watch import Lives

    Whole = NDArray[np.int64]

UNSENT = 1 << 11
"""Bit of `exchange` for a SYNC that could not be sent."""
NOT_PLAIN = -1 << 20
"""In place of a time: the position is not commanded as it is, and nothing was sent."""
LOWEST, HIGHEST = -(2**31), 2**31 - 1
_TARGET_BITS = 0xFFFFFFFF  # a target is a signed number of 32 bits
_BITS = 8  # of a byte: places in a frame count bytes


class Sync:
    """Fields of SYNC: its id, the next count and the last one (0: none), and when it was sent."""

    can_id: int
    count: int
    last: int
    sent_ns: int


_SYNC = record_type(Sync)
COUNT, SENT = map(list(Sync.__annotations__).index, ("count", "sent_ns"))
"""Places of its count and its time among the words of a SYNC."""
Syncs = NDArray[np.record]


def new_sync(can_id: int, last: int | None) -> Syncs:
    """Return the SYNC (1,) of an id, which counts from 1 to `last`, or holds nothing."""
    syncs: Syncs = np.zeros(1, _SYNC)
    sync = cast("Sync", syncs[0])
    sync.can_id, sync.last, sync.count = can_id, last or 0, 1 if last else 0
    return syncs


@kernel
def note_sent(syncs: Syncs, sent_ns: int) -> None:
    """Note when SYNC was sent: the answers will be stamped with it. The next one counts on."""
    sync: Any = syncs[0]
    sync.sent_ns = sent_ns
    if sync.last > 0:
        sync.count = sync.count % sync.last + 1


@kernel
def send_sync(syncs: Syncs, door: Doors, words: Whole) -> bool:
    """Send SYNC; return whether it went."""
    sync: Any = syncs[0]
    length = 1 if sync.last > 0 else 0
    sent_ns = put_frame(door, words, sync.can_id | length << LENGTH_SHIFT, sync.count)
    if sent_ns > 0:
        note_sent(syncs, sent_ns)
    return sent_ns > 0


@kernel
def exchange(
    sources: Sources,
    counts: Whole,
    lives: Lives,
    readings: Readings,
    samples: StoredSample,
    door: Doors,
    lengths: Lengths,
    slots: Slots,
    words: Whole,
    syncs: Syncs,
    now_ns: int,
    asks: bool,
    sends: bool,
) -> int:
    """Receive the frames that wait at a lent door and take them by `take_cycle`.

    Return as that does; or UNUSUAL, or NOT_LENT. With `sends` the next SYNC is sent at once, where
    the cycle has ended.
    """
    count = take_lent(door, lengths, slots)
    if count <= UNUSUAL:
        return count
    sync_ns = syncs[0].sent_ns
    events = take_cycle(
        sources, counts, lives, readings, samples, slots, 0, count, sync_ns, now_ns, asks
    )
    if sends and events >= 0 and not send_sync(syncs, door, words):
        events |= UNSENT
    return events


@kernel
def target_of(drive: SourceFields, position: float) -> int:
    """Return the counts of a drive that are nearest to a position [rig unit], within its range."""
    counts = np.rint((position - drive.offset) / drive.gain)
    return int(min(max(counts, LOWEST), HIGHEST))


@kernel
def set_target(drives: Sources, position: float) -> None:
    """Take a position [rig unit] for the target of the drive (1,)."""
    drive: Any = drives[0]
    drive.target = target_of(drive, position)


@kernel
def command_word(drive: SourceFields, control: int) -> int:
    """Return the bytes of a command as a number: the target, and a controlword beside it."""
    target = (np.int64(drive.target) & np.int64(_TARGET_BITS)) << np.int64(_BITS * drive.target_at)
    return int(target | np.int64(control) << np.int64(_BITS * drive.control_at))


@kernel
def send_position(
    drives: Sources, door: Doors, words: Whole, head: int, control: int, position: float
) -> int:
    """Aim the drive (1,) and send its command; return as `put_frame` does.

    Return NOT_PLAIN if it does not follow, its zero is not known, or the position is no number.
    """
    drive: Any = drives[0]
    if drive.running == 0 or drive.aligned == 0 or not math.isfinite(position):
        return NOT_PLAIN
    drive.target = target_of(drive, position)
    return put_frame(door, words, head, command_word(drive, control))
