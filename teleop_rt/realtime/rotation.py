"""A recording in parts: a part that is large or old enough is followed by the next one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.realtime.columns import Rows
from teleop_rt.realtime.parts import number_of, part, parts
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import Signal


@dataclass(frozen=True, slots=True)
class Sizes:
    """How large and old [s] a part may become, and how much of a recording is kept."""

    part_bytes: int
    part_s: float
    kept_bytes: int
    kept_parts: int | None = None


SIZES = "recording"
"""The metadata record that says how a recording is cut into parts."""


def sizes_of(metadata: Mapping[str, Mapping[str, str]]) -> Sizes:
    """Return the sizes in a run's description."""
    sizes = metadata[SIZES]
    return Sizes(
        part_bytes=int(sizes["part_bytes"]),
        part_s=float(sizes["part_s"]),
        kept_bytes=int(sizes["kept_bytes"]),
        kept_parts=int(sizes["kept_parts"]) or None,
    )


class RotatingWriter:
    """Writes like a `RecordingWriter`, into a new part whenever the last one is full.

    It begins with the part after those that are there, so the parts of a recorder that
    crashed stay. The part being written and the one before it are never removed: as no part is
    shorter than a second, the last second before a fault is there whatever is rotated meanwhile.
    """

    def __init__(
        self,
        recording: Path,
        units: Units,
        metadata: Mapping[str, dict[str, str]] | None,
        sizes: Sizes,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the next part of `recording`. Raises RecordingError."""
        self._recording = recording
        self._units = units
        self._metadata = metadata
        self.sizes = sizes
        self._now_s = now_s
        self._tables: dict[str, Sequence[Signal]] = {}
        there = [number_of(path, recording) or 0 for path in parts(recording)]
        self._number = max(there, default=0) + 1
        self._writer = RecordingWriter(part(recording, self._number), units, metadata)
        self._since_s = now_s()
        self._not_rotated = ""

    def add_topic(self, topic: str, table: Sequence[Signal]) -> None:
        """Declare a topic, in this part and in those that follow."""
        self._tables[topic] = table
        self._writer.add_topic(topic, table)

    def write_rows(self, topic: str, rows: Rows, numbers: Iterable[int] | None = None) -> None:
        """Append rows (n, columns of the topic's table); `numbers` (n,) count them from 1."""
        self._writer.write_rows(topic, rows, numbers)

    @property
    def problem(self) -> str:
        """The disk's last error; empty while it accepts everything."""
        return self._writer.problem or self._not_rotated

    @property
    def waiting_bytes(self) -> int:
        """How much the disk has not taken yet."""
        return self._writer.waiting_bytes

    @property
    def size_bytes(self) -> int:
        """Length of the part being written [bytes], with the bytes that wait."""
        return self._writer.size_bytes

    def flush(self) -> None:
        """Hand over the written bytes; where the part is full, finish it and begin the next."""
        self._writer.flush()
        sizes = self.sizes
        full = self.size_bytes >= sizes.part_bytes or self._now_s() - self._since_s >= sizes.part_s
        if full and not self.waiting_bytes:
            self._rotate()

    def close(self) -> None:
        """Finish the part being written."""
        self._writer.close()

    def _rotate(self) -> None:
        """Begin the next part, then finish the last; a disk that refuses keeps the last going."""
        try:
            following = RecordingWriter(
                part(self._recording, self._number + 1), self._units, self._metadata
            )
        except RecordingError as error:
            self._not_rotated = str(error)
            return
        for topic, table in self._tables.items():
            following.add_topic(topic, table)
        self._writer.close()
        self._writer, self._not_rotated = following, ""
        self._number += 1
        self._since_s = self._now_s()
        self._prune()

    def _prune(self) -> None:
        """Remove the oldest parts beyond the number that is kept."""
        *older, before, _ = parts(self._recording)
        kept, count = before.stat().st_size, 2
        for path in reversed(older):
            kept, count = kept + path.stat().st_size, count + 1
            too_many = self.sizes.kept_parts is not None and count > self.sizes.kept_parts
            if kept > self.sizes.kept_bytes or too_many:
                with suppress(OSError):
                    path.unlink()
