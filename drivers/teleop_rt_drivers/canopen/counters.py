"""Counters of rejected frames, by reason, as words that kernels add to."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping

import numpy as np

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


class Counters(MutableMapping[str, int]):
    """All counters, at zero to begin with: none is added later and none is taken away."""

    def __init__(self) -> None:
        self.words = np.zeros(len(CODES), np.int64)
        self._words = self.words.data
        self._reasons = self._words[: len(REASONS)]

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
        """How many frames were rejected, for whatever reason."""
        return sum(self._reasons)
