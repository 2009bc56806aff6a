"""Counters of rejected frames, by reason, as words that kernels add to."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel

REASONS = (
    "wrong_length",
    "not_a_number",
    "out_of_range",
    "impossible_jump",
    "bad_status",
    "unsolicited",
    "unexpected_id",
    "remote_frame",
    "error_frame",
    "foreign_master",
    "emergency",
    "bad_toggle",
    "unreadable",
    "flood",
    "bad_command",
)
EVENTS = ("late", "sync_sent", "send_failed", "cycles_without_sample", "speed_saturated")
CODES = {name: code for code, name in enumerate((*REASONS, *EVENTS))}
"""Place of each counter among the words."""
TOTAL = len(CODES)
"""Place of the sum of all reasons, which `add_up` writes."""


@kernel
def add_up(words: NDArray[np.int64]) -> None:
    """Write how many frames were rejected, for whatever reason."""
    words[TOTAL] = 0
    for code in range(len(REASONS)):
        words[TOTAL] += words[code]


class Counters(MutableMapping[str, int]):
    """All counters, at zero to begin with: none is added later and none is taken away."""

    def __init__(self) -> None:
        self.words = np.zeros(len(CODES) + 1, np.int64)
        self._words = self.words.data

    def __getitem__(self, name: str) -> int:
        return self._words[CODES[name]]

    def __setitem__(self, name: str, count: int) -> None:
        self._words[CODES[name]] = count

    def __delitem__(self, name: str) -> None:
        raise TypeError(f"the counter {name} stays")

    def __iter__(self) -> Iterator[str]:
        return iter(CODES)

    def __len__(self) -> int:
        return len(CODES)

    @property
    def rejected(self) -> int:
        """How many frames had been rejected when they were added up last."""
        return self._words[TOTAL]
