"""Lines of ASCII in a byte stream, as load cells send them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from teleop_rt_drivers.framed.source import FieldInfo

if TYPE_CHECKING:
    from teleop_rt_drivers.framed.format import TextFormat
    from teleop_rt_drivers.framed.source import Source


def text_fields(line: TextFormat) -> tuple[FieldInfo, ...]:
    """Return the fields of a format."""
    return tuple(FieldInfo(field.name, field.unit, field.scale) for field in line.fields)


class TextParser:
    """Splits a stream at line ends and matches each line whole.

    The first line after a start may have lost its beginning, so it is dropped.
    """

    def __init__(self, line: TextFormat, source: Source, counters: dict[str, int]) -> None:
        self._source = source
        self._counters = counters
        self._match = re.compile(line.pattern.encode()).fullmatch
        self._names = [field.name for field in line.fields]
        self._longest = line.longest_line
        self._pending = b""
        self._begun = False

    def reset(self) -> None:
        """Forget a line that has begun."""
        self._pending = b""
        self._begun = False

    def feed(self, data: bytes, now_ns: int) -> None:
        """Take bytes as they came; at most one unfinished line is kept."""
        *lines, rest = (self._pending + data).split(b"\n")
        for line in lines:
            if self._begun:
                self._take(line.strip(b"\r"), now_ns)
            else:
                self._begun = True
                self._counters["skipped_bytes"] += len(line) + 1
        if len(rest) > self._longest:
            self._counters["too_long"] += 1
            self._begun = False
            rest = b""
        self._pending = rest

    def _take(self, line: bytes, now_ns: int) -> None:
        found = self._match(line) if len(line) <= self._longest else None
        if found is None:
            self._counters["no_match"] += 1
            return
        try:
            values = [float(found[name]) for name in self._names]
        except (TypeError, ValueError):
            self._counters["not_a_number"] += 1
            return
        self._counters["frames"] += 1
        self._source.deliver(values, now_ns)
