"""The numbers of recorded rows, taken out of their text by one kernel; for very many rows.

A row that is not as the first one was, or holds anything but numbers and null, is left to others.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.realtime.system_calls import number_in_text

Bytes = NDArray[np.uint8]
Whole = NDArray[np.int64]
Rows = NDArray[np.float64]

_NOT_WANTED = -1  # in place of a column's number in the wanted row
_ZERO, _NINE, _MINUS, _PLUS, _POINT, _COMMA, _END, _SMALL_E, _LARGE_E = (
    ord(letter) for letter in "09-+.,}eE"
)
_NULL = (ord("n"), ord("u"), ord("l"), ord("l"))
_MOST_DIGITS = 18
"""Decimal digits that 64 bits hold in any case."""
_EXACT = 1 << 53
_EXACT_TENS = 22
"""Whole numbers, and powers of ten, up to which floating point of 64 bits is exact: so is the one
rounding of their product or quotient."""


@kernel
def skip_digits(data: Bytes, at: int, end: int) -> int:
    """Return where the digits that begin here end."""
    while at < end and _ZERO <= data[at] <= _NINE:
        at += 1
    return at


@kernel
def is_null(data: Bytes, at: int, end: int) -> bool:
    """Return whether a value is null."""
    same = end - at == len(_NULL)
    for place in range(len(_NULL)):
        same = same and data[at + place] == _NULL[place]
    return same


@kernel
def is_number(data: Bytes, at: int, end: int, parts: Whole) -> bool:
    """Return whether a value is a number, as JSON writes it.

    In `parts` it writes where the whole part, the fraction and the exponent end.
    """
    first = at + 1 if data[at] == _MINUS else at
    parts[0] = skip_digits(data, first, end)
    if parts[0] == first or (data[first] == _ZERO and parts[0] > first + 1):
        return False
    parts[1] = parts[0]
    if parts[0] < end and data[parts[0]] == _POINT:
        parts[1] = skip_digits(data, parts[0] + 1, end)
        if parts[1] == parts[0] + 1:
            return False
    parts[2] = parts[1]
    if parts[1] < end and (data[parts[1]] == _SMALL_E or data[parts[1]] == _LARGE_E):
        power = parts[1] + 1
        if power < end and (data[power] == _PLUS or data[power] == _MINUS):
            power += 1
        parts[2] = skip_digits(data, power, end)
        if parts[2] == power:
            return False
    return bool(parts[2] == end)


@kernel
def number_of(data: Bytes, base: int, at: int, parts: Whole, ends_place: int) -> float:
    """Return the number (`is_number`) that begins here, correctly rounded.

    data lie at the address `base`, the last word of `parts` (4,) at `ends_place`.
    """
    is_negative = data[at] == _MINUS
    first = at + 1 if is_negative else at
    after_point = max(0, int(parts[1] - parts[0]) - 1)
    is_short = parts[1] - first <= _MOST_DIGITS and parts[2] == parts[1]
    number = np.int64(0)
    if is_short:
        for place in range(first, int(parts[1])):
            if data[place] != _POINT:
                number = number * np.int64(10) + np.int64(data[place]) - np.int64(_ZERO)
    if not is_short or (after_point > 0 and number > _EXACT):
        return number_in_text(base + at, parts[3:], ends_place, parts[2] - at)
    if after_point == 0:
        return float(-number if is_negative else number)
    tens = 1.0
    for _ in range(after_point):
        tens *= 10.0
    value = float(number) / tens
    return -value if is_negative else value


@kernel
def read_row(
    data: Bytes,
    base: int,
    at: int,
    end: int,
    keys: Bytes,
    ends: Whole,
    wanted: Whole,
    parts: Whole,
    ends_place: int,
    rows: Rows,
    to: int,
) -> int:
    """Read a row's wanted numbers into place `to`; return where they end, 0 for another row.

    `keys` are the texts before each value, one after the other, up to `ends` (n,); `wanted` (n,)
    holds the column of each.
    """
    begin = 0
    for field in range(len(ends)):
        length = ends[field] - begin
        if at + length >= end:
            return 0
        for byte in range(length):
            if data[at + byte] != keys[begin + byte]:
                return 0
        at, begin = at + length, ends[field]
        stop = at
        while stop < end and data[stop] != _COMMA and data[stop] != _END:
            stop += 1
        value = math.nan
        if not is_null(data, at, stop):
            if stop == at or not is_number(data, at, stop, parts):
                return 0
            if wanted[field] >= 0:
                value = number_of(data, base, at, parts, ends_place)
                if not math.isfinite(value):
                    return 0
        if wanted[field] >= 0:
            rows[wanted[field], to] = value
        at = stop
    return at


@kernel
def read_rows(
    data: Bytes,
    base: int,
    places: Whole,
    whole: bool,
    keys: Bytes,
    ends: Whole,
    wanted: Whole,
    parts: Whole,
    ends_place: int,
    rows: Rows,
) -> int:
    """Read rows that lie at these places (n, 3); return how many, up to one that is otherwise.

    With `whole` the last key is that of the row's last value, and the row ends there.
    """
    for row in range(len(places)):
        begin, end = places[row, 0], places[row, 1]
        at = read_row(data, base, begin, end, keys, ends, wanted, parts, ends_place, rows, row)
        is_last = at == end - 1 and data[at] == _END
        goes_on = 0 < at < end and data[at] == _COMMA
        if not (is_last if whole else goes_on):
            return row
    return len(places)


class RowReader:
    """Reads rows whose text is as that of the first one: these names, in this order."""

    def __init__(self, names: Sequence[str], wanted: Sequence[str]) -> None:
        last = max(names.index(name) for name in wanted)
        used = names[: last + 1]
        texts = [f"{',' if place else '{'}{json.dumps(name)}:" for place, name in enumerate(used)]
        self._whole = len(used) == len(names)
        self._keys = np.frombuffer("".join(texts).encode(), np.uint8)
        self._ends = np.cumsum([len(text.encode()) for text in texts])
        places = {name: place for place, name in enumerate(wanted)}
        self._wanted = np.array([places.get(name, _NOT_WANTED) for name in used])
        self._parts = np.zeros(4, np.int64)
        self._ends_place = self._parts[3:].ctypes.data

    def read(self, data: bytes, places: Whole, rows: Rows) -> int:
        """Read into the columns `rows` (names, rows); return how many rows were read."""
        text = np.frombuffer(data, np.uint8)
        return read_rows(
            text, text.ctypes.data, np.ascontiguousarray(places), self._whole, self._keys,
            self._ends, self._wanted, self._parts, self._ends_place, rows,
        )  # fmt: skip
