"""FramedCounters of rejected frames, by reason, and of further events."""

from __future__ import annotations

REASONS = (
    "bad_checksum",
    "bad_end",
    "wrong_length",
    "no_match",
    "too_long",
    "repeated",
    "not_a_number",
    "out_of_range",
    "impossible_jump",
    "bad_status",
    "stale_state",
    "unexpected_id",
    "remote_frame",
    "error_frame",
    "unreadable",
    "flood",
    "bad_command",
)
EVENTS = (
    "frames",
    "gaps",
    "skipped_bytes",
    "clock_outliers",
    "send_failed",
    "line_busy",
    "answered_late",
    "cycles_without_sample",
)
_ARE_EVENTS = frozenset(EVENTS)


class FramedCounters(dict[str, int]):
    """All counters, at zero to begin with: none is added later.

    `rejected` is how many frames were rejected, for whatever reason: a tick asks for it each time,
    and a sum over all reasons takes ten times as long.
    """

    def __init__(self) -> None:
        super().__init__(dict.fromkeys((*REASONS, *EVENTS), 0))
        self.rejected = 0

    def __setitem__(self, name: str, count: int) -> None:
        if name not in _ARE_EVENTS:
            self.rejected += count - self[name]
        dict.__setitem__(self, name, count)
