"""A value out of frames, as kernels: plausibility of a frame, and the value of a cycle."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.jit import kernel
from teleop_rt.kernel_record import record_type
from teleop_rt_drivers.device_clock import take_count

if TYPE_CHECKING:
    from teleop_rt_drivers.device_clock import Stored

COUNTERS = ("", "bad_status", "not_a_number", "out_of_range", "repeated", "clock_outliers")
"""By code what counts a frame; the value of one whose time alone is an outlier is kept."""
FINE, _BAD_STATUS, _NOT_A_NUMBER, _OUT_OF_RANGE, _REPEATED, _CLOCK_OUTLIER = range(len(COUNTERS))
NOTHING, NEW, JUMPED = range(3)
"""Results of a cycle: no value, a new one, or one that is rejected because it jumped."""


class Value:
    """Fields of a value: its scale, what it can be, the newest frame's and the one taken over."""

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


_VALUE = record_type(Value)
_NAMES = list(Value.__annotations__)
StoredValue = NDArray[np.record]


def new_value() -> StoredValue:
    """Return a zeroed value (1,)."""
    return np.zeros(1, _VALUE)


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
    s: Any = stored[0]
    value = s.offset + s.gain * raw
    if not good:
        return _BAD_STATUS
    if not math.isfinite(value):
        return _NOT_A_NUMBER
    if not s.lower <= value <= s.upper:
        return _OUT_OF_RANGE
    found = FINE
    if s.has_clock > 0:
        c: Any = clock[0]
        if c.samples > 0 and count == c.count:  # it stands still: a frozen device
            return _REPEATED
        outliers = c.outliers
        s.candidate_device_ns = take_count(c, count, now_ns)
        if c.outliers > outliers:
            found = _CLOCK_OUTLIER
    s.candidate, s.candidate_ns = value, now_ns
    return found


@kernel
def settle(stored: StoredValue) -> int:
    """Take over what this cycle brought if it did not jump; return what that is."""
    s: Any = stored[0]
    candidate = s.candidate
    s.candidate = math.nan
    if math.isnan(candidate):
        return NOTHING
    reach = s.slack + s.rate * ((s.candidate_ns - s.stamp_ns) * 1e-9)
    if s.known > 0 and abs(candidate - s.value) > reach:
        return JUMPED
    s.value, s.stamp_ns, s.known = candidate, s.candidate_ns, 1
    s.device_stamp_ns = s.candidate_device_ns
    return NEW
