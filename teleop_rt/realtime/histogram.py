"""Histograms of wake latency and work, in arrays that are allocated once and shared by a file."""

from __future__ import annotations

import mmap
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

BIN_US = 1
BINS = 10_000
"""Times of 1 µs to 10 ms are told apart; the last bin takes all that is longer."""
NAME = "timing.histograms"
KINDS = ("wake_latency", "work")
QUANTILES = (0.5, 0.99, 0.999)


class TimingHistograms:
    """Counts of wake latency and work by microsecond; `add` allocates nothing that grows."""

    def __init__(self, folder: Path, *, create: bool = False) -> None:
        """Map the file of a session; the loop's end creates it. Raises FileNotFoundError."""
        size = 8 * (BINS + 1) * len(KINDS)
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
        self._counts = [words[i * (BINS + 1) : (i + 1) * (BINS + 1)] for i in range(len(KINDS))]
        self._wake_latency, self._work = self._counts

    def add(self, wake_latency_us: float, work_us: float) -> None:
        """Count one tick."""
        self._wake_latency[min(int(wake_latency_us), BINS)] += 1
        self._work[min(int(work_us), BINS)] += 1

    def counts(self, kind: str) -> NDArray[np.uint64]:
        """Return how many ticks took 0, 1, 2 ... µs, shape (BINS + 1,)."""
        return np.array(self._counts[KINDS.index(kind)], dtype=np.uint64)

    def quantiles(self, kind: str) -> dict[str, float] | None:
        """Return p50, p99, p999 and max [µs], each rounded up; None before the first tick."""
        return quantiles_of(self.counts(kind))


def quantiles_of(
    counts: NDArray[np.uint64], shares: Sequence[float] = QUANTILES
) -> dict[str, float] | None:
    """Return the quantiles of counts per microsecond [µs], each rounded up."""
    below = np.cumsum(counts)
    if below.size == 0 or below[-1] == 0:
        return None
    last = float(below[-1])
    found = {
        f"p{f'{share:g}'[2:]:0<2}": float(np.searchsorted(below, np.ceil(share * last)) + BIN_US)
        for share in shares
    }
    return found | {"max": float(np.flatnonzero(counts)[-1] + BIN_US)}
