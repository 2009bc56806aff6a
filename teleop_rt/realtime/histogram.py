"""Histograms of wake latency and work, in arrays that are allocated once and shared by a file."""

from __future__ import annotations

import mmap
import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

BIN_US = 1
"""Width of a bin."""
BINS = 10_000
"""Times of 1 µs to 10 ms have a bin each; the last bin takes all longer ones."""
_LONGEST = BINS + 1  # place of the longest time
_WORDS = BINS + 2
"""Of each kind: the bins, and the longest time [µs]."""
NAME = "timing.histograms"
KINDS = ("wake_latency", "work")
QUANTILES = (0.5, 0.99, 0.999)  # that status and summary give of each kind


class TimingHistograms:
    """Counts of wake latency and work by microsecond; `add` allocates nothing that grows."""

    def __init__(self, folder: Path, *, create: bool = False) -> None:
        """Map the file in a ring folder; the loop's end creates it. Raises FileNotFoundError."""
        size = 8 * _WORDS * len(KINDS)
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL if create else os.O_RDONLY
        descriptor = os.open(folder / NAME, flags, 0o640)
        try:
            if create:
                os.posix_fallocate(descriptor, 0, size)
            access = mmap.ACCESS_WRITE if create else mmap.ACCESS_READ
            memory = mmap.mmap(descriptor, size, access=access)
        finally:
            os.close(descriptor)
        words = memoryview(memory).cast("Q")
        self._counts = [words[i * _WORDS : (i + 1) * _WORDS] for i in range(len(KINDS))]
        self._wake_latency, self._work = self._counts

    def add(self, wake_latency_us: float, work_us: float) -> None:
        """Count one tick."""
        _count(self._wake_latency, int(wake_latency_us))
        _count(self._work, int(work_us))

    def counts(self, kind: str) -> NDArray[np.uint64]:
        """Return how many ticks took 0, 1, 2 ... µs, shape (BINS + 1,)."""
        return np.array(self._counts[KINDS.index(kind)][: BINS + 1], dtype=np.uint64)

    def quantiles(self, kind: str) -> dict[str, float] | None:
        """Return p50, p99, p999 and max [µs], each rounded up; None before the first tick.

        A quantile beyond the last bin is reported as the longest time, its upper bound.
        """
        longest_us = float(self._counts[KINDS.index(kind)][_LONGEST] + BIN_US)
        below = np.cumsum(self.counts(kind))
        if not below[-1]:
            return None
        found = {}
        for share in QUANTILES:
            index = np.searchsorted(below, np.ceil(share * float(below[-1])))
            name = f"p{f'{share:g}'[2:]:0<2}"
            found[name] = float(index + BIN_US) if index < BINS else longest_us
        return found | {"max": longest_us}


def _count(counts: memoryview[int], time_us: int) -> None:
    counts[min(time_us, BINS)] += 1
    if time_us > counts[_LONGEST]:  # noqa: PLR1730 - a call of max() costs as much as all the rest
        counts[_LONGEST] = time_us
