"""A row into its ring by one kernel; readers of rings do without the compiler."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.realtime.ring import CAPACITY_WORD, COUNT_WORD, HEADER_WORDS, RingWriter, Row
from teleop_rt.realtime.system_calls import keep_order


@kernel
def put(header: NDArray[np.int64], words: Row, row: Row) -> None:
    """Write a row (columns,) over the oldest one: its number before and after it, then the count.

    header and words are the whole ring, as whole numbers and as floating-point ones.
    """
    number = header[COUNT_WORD] + 1
    columns = len(row)
    first = HEADER_WORDS + number % header[CAPACITY_WORD] * (columns + 2)
    words[first] = number
    keep_order()
    for column in range(columns):
        words[first + 1 + column] = row[column]
    keep_order()
    words[first + 1 + columns] = number
    keep_order()
    header[COUNT_WORD] = number


def row_writer(ring: RingWriter, row: Row) -> Callable[[], None]:
    """Return a function that writes the current values of this row (columns,) into the ring."""
    return bound(put, (*ring_words(ring), row))


def ring_words(ring: RingWriter) -> tuple[NDArray[np.int64], Row]:
    """Return a ring as `put` takes it: as whole numbers and as floating-point ones."""
    memory = ring.memory
    return np.frombuffer(memory, np.int64), np.frombuffer(memory, np.float64)
