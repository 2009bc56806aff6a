"""Rows of a recorded topic as columns, thinned where they are too many."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from teleop_rt.realtime.mcap_records import Place

if TYPE_CHECKING:
    from teleop_rt.realtime.row_kernel import RowReader

Rows = NDArray[np.float64]
_BLOCK_ROWS = 2048
"""Rows collected before they become an array."""
_ROWS_FOR_KERNEL = 100_000
"""Rows of a topic beyond which a kernel pays that reads one in a fourth of the time: it loads for
0.5 s, once for all topics."""
_BYTES = 8
"""Of a number."""


class TopicColumns:
    """The rows of a topic as columns; every second one is dropped where they grow too many.

    Each column is an array of its own, so that whoever keeps one does not hold all in memory.
    """

    def __init__(
        self, wanted: Sequence[str] | None, most: int | None, expected: int, may_take: int
    ) -> None:
        """Take `expected` rows, 0 where unknown: rows that would be dropped later are not read.

        Room for them is made at once where it takes no more bytes than `may_take`.
        """
        self._wanted, self._most, self._may_take = wanted, most, may_take
        self._names: list[str] = []
        self._after = b""
        self._waiting: list[list[float | None]] = []
        self._columns: list[Rows] = []
        self._held = self._count = 0
        self._step = 1
        while most is not None and expected > most * self._step:
            self._step *= 2
        self._expected = expected // self._step + 2
        self._last = b""
        self._reader: RowReader | None = None

    def take(self, data: bytes, places: Place) -> None:
        """Take rows in, as JSON that lies at these places of `data`."""
        shown = places[-self._count % self._step :: self._step]
        if self._reader is not None:
            shown = shown[self._read(self._reader, data, shown) :]
        self._waiting += [self._values(data[begin:end]) for begin, end, _ in shown.tolist()]
        self._count += len(places)
        begin, end, _ = places[-1].tolist()
        self._last = data[begin:end]
        if len(self._waiting) >= _BLOCK_ROWS:
            self._pack()
        while self._most is not None and self._held + len(self._waiting) > self._most:
            self._thin()

    def _read(self, reader: RowReader, data: bytes, shown: Place) -> int:
        """Read rows by a kernel, up to one that it leaves; return how many."""
        rows = np.empty((len(self._names), len(shown)))
        count = reader.read(data, shown, rows)
        self._pack()
        self._append(rows[:, :count])
        return count

    @property
    def size_bytes(self) -> int:
        """Return how much memory the columns take."""
        return (self._held + len(self._waiting)) * len(self._names) * _BYTES

    def whole(self) -> dict[str, Rows]:
        """Return the columns."""
        if self._count and (self._count - 1) % self._step:
            self._waiting.append(self._values(self._last))
        self._pack()
        columns = (column[: self._held] for column in self._columns)
        return dict(zip(self._names, columns, strict=True))

    def _values(self, text: bytes) -> list[float | None]:
        if self._after and (cut := text.find(self._after)) > 0:
            text = text[:cut] + b"}"  # nothing that follows is wanted
        message = from_json(text)  # a third of json's time
        if not self._names:
            self._choose(list(message))
        return [message[name] for name in self._names]

    def _choose(self, names: Sequence[str]) -> None:
        """Find the wanted names in the first row, and the one that follows the last of them."""
        wanted = self._wanted
        self._names = [name for name in names if wanted is None or name in wanted]
        if self._names and self._names[-1] != names[-1]:
            following = names[names.index(self._names[-1]) + 1]
            self._after = f",{json.dumps(following)}:".encode()
        if self._names and self._expected > _ROWS_FOR_KERNEL:
            from teleop_rt.realtime.row_kernel import RowReader  # noqa: PLC0415 - needs the compiler

            self._reader = RowReader(names, self._names)

    def _pack(self) -> None:
        """Move the waiting rows into the columns."""
        if self._waiting:
            shape = len(self._waiting), len(self._names)
            self._append(np.array(self._waiting, dtype=np.float64).reshape(shape).T)
            self._waiting = []

    def _append(self, rows: Rows) -> None:
        """Append rows (names, rows) to the columns, which grow where more came than expected."""
        held = self._held + rows.shape[1]
        if not self._columns:
            believed = self._expected * len(self._names) * _BYTES <= self._may_take
            size = max(self._expected if believed else 0, held)
            self._columns = [np.empty(size) for _ in self._names]
        for place, column in enumerate(self._columns):
            if held > len(column):
                self._columns[place] = np.concatenate((column, np.empty(held)))
            self._columns[place][self._held : held] = rows[place]
        self._held = held

    def _thin(self) -> None:
        self._pack()
        for column in self._columns:
            kept = column[: self._held : 2].copy()
            column[: len(kept)] = kept
        self._held = (self._held + 1) // 2
        self._step *= 2
