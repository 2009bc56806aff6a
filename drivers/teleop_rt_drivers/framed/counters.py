"""Counters of rejected frames, by reason, and of further events."""

from __future__ import annotations

from operator import itemgetter

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
_of_all_reasons = itemgetter(*REASONS)


def new_counters() -> dict[str, int]:
    """Return all counters at zero: none is added later."""
    return dict.fromkeys((*REASONS, *EVENTS), 0)


def rejected(counters: dict[str, int]) -> int:
    """Return how many frames were rejected, for whatever reason."""
    return sum(_of_all_reasons(counters))
