"""Fields of a table in text: numbers, with a point or a comma, and stamps of date and time."""

from __future__ import annotations

import math
import re
from datetime import UTC, datetime, time

_FIGURE = re.compile(
    r"[-+]?(\d+[.,]?\d*|[.,]\d+)(e[-+]?\d+)?|[-+]?(nan|inf|infinity)", re.IGNORECASE
)
_MINUTES = re.compile(r"(\d{1,3}):(\d{2}[.,]\d+)")
_GERMAN_DATE = re.compile(r"(\d{1,2})\.(\d{1,2})\.(\d{4})\s+(.+)")


def is_number(cell: str) -> bool:
    """Return whether a field is a number or a stamp."""
    return _FIGURE.fullmatch(cell) is not None or _seconds_of(cell) is not None


def number_of(cell: str) -> float:
    """Return the number in a field, the seconds of a stamp, or not-a-number."""
    cell = cell.strip().strip('"').strip()
    if _FIGURE.fullmatch(cell):
        return float(cell.replace(",", "."))
    seconds = _seconds_of(cell)
    return math.nan if seconds is None else seconds


def _seconds_of(cell: str) -> float | None:
    """Return the seconds of a stamp, of a day or since 1970 (UTC where it names no zone)."""
    german = _GERMAN_DATE.fullmatch(cell)
    if german is not None:
        day, month, year, clock = german.groups()
        cell = f"{year}-{month:0>2}-{day:0>2} {clock}"
    if ":" not in cell:
        return None
    if (minutes := _MINUTES.fullmatch(cell)) is not None:
        return 60.0 * float(minutes[1]) + float(minutes[2].replace(",", "."))
    try:
        stamp = datetime.fromisoformat(cell.replace(",", "."))
    except ValueError:
        pass
    else:
        return (stamp if stamp.tzinfo else stamp.replace(tzinfo=UTC)).timestamp()
    try:
        clock_time = time.fromisoformat(cell.replace(",", "."))
    except ValueError:
        return None
    hours = clock_time.hour * 60 + clock_time.minute
    return 60.0 * hours + clock_time.second + 1e-6 * clock_time.microsecond
