"""The way of a frame of process data, as kernels: decoding, checks, the match to its SYNC.

They work on the records of `source`. Frames lie in slots, as `can_frames` has them.
"""

from __future__ import annotations

import functools
import math
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import Sample
from teleop_rt.kernels.jit import kernel
from teleop_rt_drivers.can_frames import DATA_AT, LENGTH_AT
from teleop_rt_drivers.canopen.counters import CODES, TOTAL, add_up
from teleop_rt_drivers.canopen.source import NOWHERE, SourceRecord, new_reading
from teleop_rt_drivers.canopen.watch import hear, lost_life, new_lives

if TYPE_CHECKING:
    from teleop_rt.axis import SampleFields, StoredSample
    from teleop_rt_drivers.can_frames import Slots
    from teleop_rt_drivers.canopen.source import Reading, Readings, SourceFields, Sources
    from teleop_rt_drivers.canopen.watch import Lives

    Whole = NDArray[np.int64]

DUPLICATE_CYCLES = 3
"""Cycles in a row with more answers than were ever owed: then a second sender is believed."""
CYCLES_TO_CATCH_UP = 3
"""Answered cycles that a node may stay behind; then its missing answers count as lost."""
MOST_ANSWERS_OWED = 10_000
"""Answers that a node is remembered to owe: of 10 s at 1 kHz; more come from a second sender."""
SILENT_CYCLES = 3
"""Cycles without an answer after which the drive's state is no longer believed."""
DUPLICATE = 1 << 8
"""Bit of `settle` for a second sender; below it those of sources that gave no new value."""
LOST = 1 << 9
"""Bit of `take_cycle` for a node whose heartbeat ended, or says that it has left."""
CHANGED = 1 << 10
"""Bit of `take_cycle` for a statusword that `Drive.settle` has not seen."""
_STATE_BITS = 0x7F  # of a heartbeat's byte (CiA 301); the highest one is not the state's

_KINDS = "bBhHiIqQfd"
"""Formats of fields, by their codes for kernels."""
_FLOAT, _DOUBLE, _UNSIGNED_LONG = map(_KINDS.index, "fdQ")
_SIZES = tuple(struct.calcsize("<" + kind) for kind in _KINDS)
_LATE, _UNSOLICITED = CODES["late"], CODES["unsolicited"]
_WRONG_LENGTH, _BAD_STATUS = CODES["wrong_length"], CODES["bad_status"]
_NOT_A_NUMBER, _OUT_OF_RANGE = CODES["not_a_number"], CODES["out_of_range"]
_SYNC_SENT, _WITHOUT_SAMPLE = CODES["sync_sent"], CODES["cycles_without_sample"]
_IMPOSSIBLE_JUMP, _SPEED_SATURATED = CODES["impossible_jump"], CODES["speed_saturated"]


def format_code(layout: str) -> int:
    """Return the code of a field's format for kernels."""
    return _KINDS.index(layout)


@kernel
def number(slots: Slots, row: int, at: int, kind: int) -> float:
    """Return the number of this kind that begins at byte `at` of a frame's data."""
    word = np.uint64(0)
    size = _SIZES[kind]
    for byte in range(size):
        word |= np.uint64(slots[row, DATA_AT + at + byte]) << np.uint64(8 * byte)
    if kind == _FLOAT:
        return float(np.uint32(word).view(np.float32))
    if kind == _DOUBLE:
        return float(np.uint64(word).view(np.float64))
    if kind == _UNSIGNED_LONG:
        return float(word)
    whole = np.int64(word)
    if kind % 2 == 0 and size < 8 and whole >> (8 * size - 1):  # signed, and negative
        whole -= np.int64(1) << np.int64(8 * size)
    return float(whole)


@kernel
def take_value(source: SourceFields, slots: Slots, row: int, counts: Whole) -> None:
    """Take a frame as a source's answer: keep its value if that can be true."""
    source.received += 1
    if slots[row, LENGTH_AT] != source.length:
        counts[_WRONG_LENGTH] += 1
        return
    value = source.offset + source.gain * number(slots, row, source.number_at, source.number_kind)
    good = source.status_at < 0 or number(slots, row, source.status_at, source.status_kind) == 0.0
    # Not-a-number is in no range.
    if source.lower <= value <= source.upper and good:
        source.candidate = value
    elif not math.isfinite(value):
        counts[_NOT_A_NUMBER] += 1
    elif not good:
        counts[_BAD_STATUS] += 1
    else:
        counts[_OUT_OF_RANGE] += 1
    if source.extra_at >= 0:
        extra = number(slots, row, source.extra_at, source.extra_kind)
        if abs(extra) >= source.most_extra:
            counts[_SPEED_SATURATED] += 1


@kernel
def take_drive(source: SourceFields, slots: Slots, row: int, counts: Whole) -> None:
    """Take a frame as the drive's answer."""
    source.received += 1
    if slots[row, LENGTH_AT] != source.length:
        counts[_WRONG_LENGTH] += 1
        return
    source.statusword = int(number(slots, row, source.status_at, source.status_kind))
    source.actual = number(slots, row, source.number_at, source.number_kind)
    if source.extra_at >= 0:
        source.force_counts = number(slots, row, source.extra_at, source.extra_kind)
    source.silent_cycles = -1


@kernel
def take_heartbeat(
    lives: Lives, counts: Whole, can_id: int, length: int, byte: int, now_ns: int
) -> bool:
    """Take a frame that is a node's heartbeat; return whether it is one."""
    for index in range(len(lives)):
        life: Any = lives[index]
        if life.cob_id == can_id:
            if length == 1:
                hear(life, byte & _STATE_BITS, now_ns)
            else:
                counts[_WRONG_LENGTH] += 1
            return True
    return False


@kernel
def take_frames(
    sources: Sources,
    counts: Whole,
    lives: Lives,
    slots: Slots,
    first: int,
    count: int,
    now_ns: int,
) -> int:
    """Take frames from `first` on; return the first one that is no source's, else `count`.

    Nor is a heartbeat handed back, of a node whose COB-ID is among the `lives`.
    """
    for row in range(first, count):
        can_id = np.int64(0)
        for byte in range(4):
            can_id |= np.int64(slots[row, byte]) << np.int64(8 * byte)
        taken = False
        for index in range(len(sources)):
            source: Any = sources[index]
            if source.cob_id == can_id:
                taken = True
                if source.is_drive > 0:
                    take_drive(source, slots, row, counts)
                else:
                    take_value(source, slots, row, counts)
        if not taken:
            length, byte = slots[row, LENGTH_AT], slots[row, DATA_AT]
            if not take_heartbeat(lives, counts, int(can_id), length, byte, now_ns):
                return row
    return count


@kernel
def note_sync_sent(sources: Sources) -> None:
    """Note that a SYNC was sent: every source owes an answer."""
    for index in range(len(sources)):
        source: Any = sources[index]
        if source.owed < MOST_ANSWERS_OWED:
            source.owed += 1


@kernel
def answers(source: SourceFields, counts: Whole) -> bool:
    """Return whether the newest answer of this cycle belongs to the newest SYNC."""
    received = source.received
    source.received = 0
    if received > source.owed:
        book_excess(source, received - source.owed, counts)
        return False
    source.excess_cycles = 0
    source.owed -= received
    if source.owed == 0:  # nearly always: one asked, one answered
        source.behind_cycles = 0
        return received > 0
    if received == 0:
        return False
    source.behind_cycles += 1
    if source.behind_cycles < CYCLES_TO_CATCH_UP:
        counts[_LATE] += received
        return False
    source.given_up = min(source.given_up + source.owed, MOST_ANSWERS_OWED)
    source.owed = source.behind_cycles = 0
    return True


@kernel
def book_excess(source: SourceFields, excess: int, counts: Whole) -> None:
    """Book answers beyond those owed: late ones as far as some were given up."""
    source.owed = source.behind_cycles = 0
    late = min(excess, source.given_up)
    source.given_up -= late
    counts[_LATE] += late
    counts[_UNSOLICITED] += excess - late
    source.excess_cycles = source.excess_cycles + 1 if excess > late else 0


@kernel
def take_over(source: SourceFields, belongs: bool, counts: Whole, sync_ns: int) -> bool:
    """Take over this cycle's value if it is new, belongs to the SYNC and did not jump."""
    candidate = source.candidate
    source.candidate = math.nan
    if not belongs or math.isnan(candidate):
        return False
    if source.known > 0:
        reach = source.slack + source.rate_per_ns * (sync_ns - source.stamp_ns)
        if abs(candidate - source.value) > reach:
            counts[_IMPOSSIBLE_JUMP] += 1
            return False
    source.value, source.stamp_ns, source.known = candidate, sync_ns, 1
    return True


@kernel
def end_cycle(sources: Sources, counts: Whole, sync_ns: int) -> int:
    """End a cycle and add up; return a bit for each value that is not new, and DUPLICATE."""
    events = 0
    for index in range(len(sources)):
        source: Any = sources[index]
        belongs = answers(source, counts)
        if source.is_drive > 0:
            source.silent_cycles = min(source.silent_cycles + 1, SILENT_CYCLES)
        elif not take_over(source, belongs, counts, sync_ns):
            events |= 1 << index
        if source.excess_cycles >= DUPLICATE_CYCLES:
            events |= DUPLICATE
    add_up(counts)
    return events


@kernel
def fill_sample(reading: Reading, sample: SampleFields, sources: Sources) -> None:
    """Write the sources' values into a sample; it is as old as the older one."""
    sample.stamp_ns = 0
    if reading.encoder >= 0:
        encoder: Any = sources[reading.encoder]
        sample.position, sample.position_stamp_ns = encoder.value, encoder.stamp_ns
        sample.stamp_ns = encoder.stamp_ns
    if reading.force_sensor >= 0:
        sensor: Any = sources[reading.force_sensor]
        sample.force, sample.force_stamp_ns = sensor.value, sensor.stamp_ns
        if reading.encoder < 0 or sensor.stamp_ns < sample.stamp_ns:
            sample.stamp_ns = sensor.stamp_ns
    if reading.drive >= 0:
        drive: Any = sources[reading.drive]
        sample.enabled = drive.running > 0 and drive.silent_cycles < SILENT_CYCLES
        sample.has_drive_position, sample.has_drive_force = 1, drive.extra_at >= 0
        sample.drive_position = drive.offset + drive.gain * drive.actual
        sample.drive_force = drive.force_gain * drive.force_counts


@kernel
def note_validity(reading: Reading, sample: SampleFields, events: int, counts: Whole) -> None:
    """Write whether a cycle completed a sample, and the errors so far."""
    sample.valid = events & (DUPLICATE - 1) == 0
    if sample.valid > 0:
        reading.missing = 0
    else:
        reading.missing += 1
        counts[_WITHOUT_SAMPLE] += 1
    sample.missing, sample.rejected = reading.missing, counts[TOTAL]
    sample.fault, sample.switch = reading.fault, reading.closed


@kernel
def take_cycle(
    sources: Sources,
    counts: Whole,
    lives: Lives,
    readings: Readings,
    samples: StoredSample,
    slots: Slots,
    first: int,
    count: int,
    sync_ns: int,
    now_ns: int,
    asks: bool,
) -> int:
    """Take frames from `first` on and end the cycle; with `asks` the next SYNC is sent then.

    The sample is filled, but for the events, which Python adds. Return as `settle` does, LOST
    and CHANGED. Where a frame is for somebody else nothing has ended: -1 minus its place.
    """
    row = take_frames(sources, counts, lives, slots, first, count, now_ns)
    if row < count:
        return -1 - row
    events = end_cycle(sources, counts, sync_ns)
    if lost_life(lives, now_ns) >= 0:
        events |= LOST
    reading: Any = readings[0]
    fill_sample(reading, samples[0], sources)
    note_validity(reading, samples[0], events, counts)
    if reading.drive >= 0 and sources[reading.drive].statusword != sources[reading.drive].seen:
        events |= CHANGED
    if asks:
        note_sync_sent(sources)
        counts[_SYNC_SENT] += 1
    return events


@functools.cache
def load_kernels() -> None:
    """Compile or load the kernels of a cycle, so that the first one does not wait for them."""
    sources, counts = SourceRecord().stored, np.zeros(TOTAL + 1, np.int64)
    slots, lives = np.zeros((1, DATA_AT + 8), np.uint8), new_lives(1)
    take_frames(sources, counts, lives, slots, 0, 1, 0)
    hear(lives[0], 0, 0)
    lost_life(lives, 0)
    note_sync_sent(sources)
    readings = new_reading(NOWHERE, NOWHERE, NOWHERE)
    arrays = sources, counts, lives, readings, Sample().stored, slots
    take_cycle(*arrays, 0, 0, 0, 0, True)  # noqa: FBT003 - as above
