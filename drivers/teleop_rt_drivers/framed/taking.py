"""A value out of frames, as kernels: plausibility of a frame, and the value of a cycle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type
from teleop_rt_drivers.device_clock import take_count

if TYPE_CHECKING:
    from teleop_rt.axis import StoredSample
    from teleop_rt_drivers.device_clock import Stored

COUNTERS = ("", "bad_status", "not_a_number", "out_of_range", "repeated", "clock_outliers")
"""The counter of a frame, by its code; a value is kept if its time alone is an outlier."""
FINE, _BAD_STATUS, _NOT_A_NUMBER, _OUT_OF_RANGE, _REPEATED, _CLOCK_OUTLIER = range(len(COUNTERS))
NOWHERE = -1  # in place of a slot
FORCE_SHIFT = 4
"""Bits of `settle_cycle` by which the finding on the force lies above that on the position."""
NOTHING, NEW, JUMPED, TOO_OLD, SILENT = 0, 1, 2, 4, 8
"""Results of a cycle: no value, a new one, or one that is rejected because it jumped.

Beside it, as bits: there is no new one and the last is too old to be held, and too old at all.
"""
NO_SAMPLE = TOO_OLD | TOO_OLD << FORCE_SHIFT
"""Bits of `settle_cycle` of which one makes a sample invalid."""
UNUSUAL = NO_SAMPLE | (JUMPED | SILENT) << FORCE_SHIFT | JUMPED | SILENT
"""Bits of `settle_cycle` for rare events."""


class Value:
    """Fields of a value: its scale and range, the newest frame's and the one taken over.

    Slots are places among the raw values of a frame, NOWHERE where there is none. A value is
    `held_ns` where no new one comes; it is silent after `timeout_ns`, counted from `watched_ns`.
    """

    offset: float
    gain: float
    lower: float
    upper: float
    rate: float
    slack: float
    has_clock: int
    candidate: float
    candidate_ns: int
    candidate_device_ns: int
    value: float
    stamp_ns: int
    device_stamp_ns: int
    known: int
    slot: int
    status_slot: int
    good: float
    clock_slot: int
    clock_bits: int
    held_ns: int
    timeout_ns: int
    watched_ns: int


_VALUE = record_type(Value)
_WORD_BITS = 64  # of the int64 in which a device's counter gets its sign
_NAMES = list(Value.__annotations__)
StoredValue = NDArray[np.record]


def new_values(count: int) -> StoredValue:
    """Return zeroed values (n,)."""
    return np.zeros(count, _VALUE)


def place(field: str) -> int:
    """Return where a field is among the words of a value."""
    return _NAMES.index(field)


@kernel
def take(
    stored: StoredValue, clock: Stored, raw: float, good: bool, count: int, now_ns: int
) -> int:
    """Keep a frame's raw value if it can be true; return the code of its counter.

    `good` is the status of the frame; count: the device's own time, by its `clock`.
    """
    return take_value(stored[0], clock[0], raw, good, count, now_ns)


@kernel
def take_value(source: Any, clock: Any, raw: float, good: bool, count: int, now_ns: int) -> int:
    """Keep a raw value as `take` does, by the records of value and clock."""
    value = source.offset + source.gain * raw
    if not good:
        return _BAD_STATUS
    if not math.isfinite(value):
        return _NOT_A_NUMBER
    if not source.lower <= value <= source.upper:
        return _OUT_OF_RANGE
    found = FINE
    if source.has_clock > 0:
        if clock.samples > 0 and count == clock.count:  # it stands still: a frozen device
            return _REPEATED
        outliers = clock.outliers
        source.candidate_device_ns = take_count(clock, count, now_ns)
        if clock.outliers > outliers:
            found = _CLOCK_OUTLIER
    source.candidate, source.candidate_ns = value, now_ns
    return found


@kernel
def take_numbers(source: Any, clock: Any, numbers: NDArray[np.float64], now_ns: int) -> int:
    """Keep the value that is among a frame's raw values, which are exact, as `take` does."""
    good = source.status_slot < 0 or numbers[source.status_slot] == source.good
    count = np.int64(0)
    if source.clock_slot >= 0:
        unused = np.int64(_WORD_BITS - source.clock_bits)
        count = np.int64(numbers[source.clock_slot]) << unused >> unused
    return take_value(source, clock, numbers[source.slot], good, int(count), now_ns)


@kernel
def settle(stored: StoredValue, now_ns: int) -> int:
    """Take over this cycle's value, and judge its age; return the finding."""
    source: Any = stored[0]
    found = take_over(source)
    if found != NEW and (source.known == 0 or now_ns - source.stamp_ns > source.held_ns):
        found |= TOO_OLD
    if now_ns - max(source.stamp_ns, source.watched_ns) > source.timeout_ns:
        found |= SILENT
    return int(found)


@kernel
def settle_cycle(
    positions: StoredValue,
    forces: StoredValue,
    samples: StoredSample,
    has_position: bool,
    has_force: bool,
    now_ns: int,
    closed: bool,
    rejected: int,
    fault: int,
) -> int:
    """Settle those values (1,) that there are and fill a sample; return the findings on them.

    The sample is as old as the older value. How many cycles lack one is left as it is, where this
    one does.
    """
    sample: Any = samples[0]
    sample.stamp_ns, found = now_ns, 0
    if has_position:
        found = settle(positions, now_ns)
        position: Any = positions[0]
        sample.position, sample.position_stamp_ns = position.value, position.stamp_ns
        sample.device_stamp_ns = position.device_stamp_ns
        sample.stamp_ns = min(sample.stamp_ns, position.stamp_ns)
    if has_force:
        found |= settle(forces, now_ns) << FORCE_SHIFT
        force: Any = forces[0]
        sample.force, sample.force_stamp_ns = force.value, force.stamp_ns
        sample.stamp_ns = min(sample.stamp_ns, force.stamp_ns)
    sample.valid = found & NO_SAMPLE == 0
    if sample.valid > 0:
        sample.missing = 0
    sample.switch, sample.rejected, sample.fault = closed, rejected, fault
    return int(found)


@kernel
def take_over(source: Any) -> int:
    """Take over this cycle's value if it did not jump; return the finding."""
    candidate = source.candidate
    source.candidate = math.nan
    if math.isnan(candidate):
        return NOTHING
    reach = source.slack + source.rate * ((source.candidate_ns - source.stamp_ns) * 1e-9)
    if source.known > 0 and abs(candidate - source.value) > reach:
        return JUMPED
    source.value, source.stamp_ns, source.known = candidate, source.candidate_ns, 1
    source.device_stamp_ns = source.candidate_device_ns
    return NEW
