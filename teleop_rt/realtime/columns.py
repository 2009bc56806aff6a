"""Rows of a recorded topic as columns, thinned where they are too many."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from teleop_rt.realtime.mcap_records import Place

Rows = NDArray[np.float64]
_BLOCK = 2048


class Columns:
    """The rows of a topic as columns; every second one is dropped where they grow too many."""

    def __init__(self, wanted: Sequence[str] | None, most: int | None, expected: int = 0) -> None:
        """Take `expected` rows, where that is known: what would be dropped later is not read."""
        self._wanted, self._most = wanted, most
        self._names: list[str] = []
        self._waiting: list[list[float | None]] = []
        self._blocks: list[Rows] = []
        self._held = self._count = 0
        self._step = 1
        while most is not None and expected > most * self._step:
            self._step *= 2
        self._last = b""

    def take(self, data: bytes, places: Place) -> None:
        """Take rows in, as JSON that lies at these places of `data`."""
        shown = places[-self._count % self._step :: self._step]
        self._waiting += [self._values(data[begin:end]) for begin, end, _ in shown.tolist()]
        self._count += len(places)
        self._held += len(shown)
        begin, end, _ = places[-1].tolist()
        self._last = data[begin:end]
        if len(self._waiting) >= _BLOCK:
            self._pack()
        while self._most is not None and self._held > self._most:
            self._thin()

    @property
    def size_bytes(self) -> int:
        """Return how much memory the columns take."""
        return self._held * len(self._names) * 8

    def whole(self) -> dict[str, Rows]:
        """Return the columns."""
        if self._count and (self._count - 1) % self._step:
            self._waiting.append(self._values(self._last))
        self._pack()
        rows = np.concatenate(self._blocks)
        self._blocks = []
        return {name: rows[:, place].copy() for place, name in enumerate(self._names)}

    def _values(self, text: bytes) -> list[float | None]:
        message = from_json(text)  # a third of what json takes
        if not self._names:
            wanted = self._wanted
            self._names = [name for name in message if wanted is None or name in wanted]
        return [message[name] for name in self._names]

    def _pack(self) -> None:
        shape = (len(self._waiting), len(self._names))
        self._blocks.append(np.array(self._waiting, dtype=np.float64).reshape(shape))
        self._waiting = []

    def _thin(self) -> None:
        self._pack()
        self._blocks = [np.concatenate(self._blocks)[::2].copy()]
        self._held = self._blocks[0].shape[0]
        self._step *= 2
