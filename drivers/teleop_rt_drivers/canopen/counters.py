"""Counters of rejected frames, by reason."""

from __future__ import annotations

from operator import itemgetter

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
_of_all_reasons = itemgetter(*REASONS)


def new_counters() -> dict[str, int]:
    """Return all counters at zero: none is added later."""
    return dict.fromkeys((*REASONS, *EVENTS), 0)


def rejected(counters: dict[str, int]) -> int:
    """Return how many frames were rejected, for whatever reason."""
    return sum(_of_all_reasons(counters))
