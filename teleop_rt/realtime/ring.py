"""A ring of float64 rows in shared memory: one writer that never waits, readers that may lose.

The file is made and removed by the writer alone; a reader only maps it, and cannot write.
Each row carries its sequence number before and after the data, so a reader sees a row that was
torn or overrun while it copied. Memory order: x86 and the ARM of this use order plain stores well
enough only together with that check, which is why both numbers are compared after the copy.
"""

from __future__ import annotations

import mmap
import os
from collections.abc import Sequence
from pathlib import Path
from struct import Struct

import numpy as np
from numpy.typing import NDArray

Row = NDArray[np.float64]

_MAGIC = 0x74726F706C657431
"""Eight letters, of which the last is the version of the layout."""
HEADER_WORDS = 8
"""Words of 8 bytes before the rows."""
_TRIES = 10
"""Reads of a row that was overwritten meanwhile, before the reader gives up."""
_MAGIC_WORD, _COLUMNS_WORD, CAPACITY_WORD, COUNT_WORD, _CLOSED_WORD = range(5)


class RingWriter:
    """The loop's end: `push`, or a kernel (`ring_kernel`), takes one row.

    Neither blocks or allocates. `memory` is the whole ring.
    """

    def __init__(self, path: Path, columns: int, capacity: int) -> None:
        """Create the file. Raises FileExistsError where one of that name stands already."""
        self.path = path
        words = HEADER_WORDS + capacity * (columns + 2)
        descriptor = os.open(path, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o640)
        try:
            os.posix_fallocate(descriptor, 0, words * 8)
            self.memory = mmap.mmap(descriptor, words * 8)
        finally:
            os.close(descriptor)
        self._header = np.frombuffer(self.memory, np.uint64, HEADER_WORDS)
        body = np.frombuffer(self.memory, np.float64, offset=HEADER_WORDS * 8)
        body[:] = 0.0  # every page is touched now, none for the first time in the loop
        self._row = Struct(f"{columns + 2}d")
        self._row_bytes = self._row.size
        header = memoryview(self.memory).cast("Q")
        self._counted = header[COUNT_WORD : COUNT_WORD + 1]
        self._rows = body.reshape(capacity, columns + 2)
        self._capacity = capacity
        self._header[_COLUMNS_WORD] = columns
        self._header[CAPACITY_WORD] = capacity
        self._header[_MAGIC_WORD] = _MAGIC

    def push(self, row: Sequence[float] | Row) -> None:
        """Copy `row` (columns,) into the ring, over the oldest one; a list is the quickest."""
        number = self._counted[0] + 1
        place = HEADER_WORDS * 8 + number % self._capacity * self._row_bytes
        self._row.pack_into(self.memory, place, number, *row, number)
        self._counted[0] = number

    def push_rows(self, rows: Row) -> None:
        """Copy rows (n, columns) into the ring, as `push` does each; n is less than its capacity.

        It takes as long as a few rows do one by one.
        """
        numbers = self._counted[0] + 1 + np.arange(len(rows))
        places, room = numbers % self._capacity, self._rows
        room[places, 0] = numbers
        room[places, 1:-1] = rows
        room[places, -1] = numbers
        self._counted[0] += len(rows)

    def close(self) -> None:
        """Mark the ring as closed for its readers, and remove the file's name."""
        self._header[_CLOSED_WORD] = 1
        self.path.unlink(missing_ok=True)


class RingReader:
    """A reader's end: `read` returns the rows that came since the last call, oldest first."""

    def __init__(self, path: Path) -> None:
        """Map an existing ring. Raises FileNotFoundError, or ValueError for another file."""
        descriptor = os.open(path, os.O_RDONLY)
        try:
            size = os.fstat(descriptor).st_size
            self._memory = mmap.mmap(descriptor, size, access=mmap.ACCESS_READ)
        finally:
            os.close(descriptor)
        self._header = np.frombuffer(self._memory, np.uint64, HEADER_WORDS)
        if (magic := int(self._header[_MAGIC_WORD])) != _MAGIC:
            ours = magic >> 8 == _MAGIC >> 8
            what = "a ring of another version" if ours else "no ring"
            raise ValueError(f"{path} is {what} of this program: start the daemon again")
        self.columns = int(self._header[_COLUMNS_WORD])
        self._capacity = int(self._header[CAPACITY_WORD])
        body = np.frombuffer(self._memory, np.float64, offset=HEADER_WORDS * 8)
        self._rows = body.reshape(self._capacity, self.columns + 2)
        self._next = 1
        self.dropped = 0

    @property
    def closed(self) -> bool:
        """True once the writer has closed its end; rows may still be waiting."""
        return bool(self._header[_CLOSED_WORD])

    @property
    def last_read(self) -> int:
        """The number of the last row that `read` has looked at; the writer counts from 1."""
        return self._next - 1

    @property
    def waiting(self) -> bool:
        """True where a row has come since the last call of `read` or `skip`."""
        return int(self._header[COUNT_WORD]) >= self._next

    def skip(self) -> None:
        """Skip the rows that have come so far."""
        self._next = int(self._header[COUNT_WORD]) + 1

    def go_on_after(self, number: int) -> None:
        """Read from the row after this one: where another reader of the ring has come to."""
        self._next = number + 1

    def read(self) -> Row:
        """Return new rows, shape (n, columns); rows overrun meanwhile are counted as dropped."""
        return self.read_numbered()[1]

    def read_numbered(self) -> tuple[NDArray[np.int64], Row]:
        """Return new rows and the number (n,) that the writer gave each."""
        last = int(self._header[COUNT_WORD])
        oldest = max(self._next, last - self._capacity + 2)
        self.dropped += oldest - self._next
        numbers = np.arange(oldest, last + 1)
        rows = self._rows[numbers % self._capacity]
        whole = (rows[:, 0] == numbers) & (rows[:, -1] == numbers)
        self.dropped += int(np.count_nonzero(~whole))
        self._next = last + 1
        return numbers[whole], np.ascontiguousarray(rows[whole, 1:-1])

    def newest(self) -> Row | None:
        """Return the newest row, shape (columns,), whatever was read; None before the first."""
        for _ in range(_TRIES):
            number = int(self._header[COUNT_WORD])
            row: Row = self._rows[number % self._capacity].copy()
            if number and row[0] == row[-1] == number:
                return row[1:-1]
        return None
