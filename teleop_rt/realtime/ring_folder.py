"""A ring folder: the folder in shared memory where the processes of a run publish their rings."""

from __future__ import annotations

import errno
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Protocol

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.columns import Rows
from teleop_rt.realtime.leftovers import remove_leftovers, shared_folder
from teleop_rt.realtime.ring import RingReader, RingWriter
from teleop_rt.realtime.state_file import found, leave
from teleop_rt.signals import Signal

PREFIX = "teleop-rt-"
METADATA = "run.metadata"
RING_ROWS = 8192
"""Rows of a ring: two seconds at the highest rate."""
RECORDER_STATE = "recorder.json"
"""The recorder's state: dropped rows, and errors of the disk."""
LAST_FAULT = "last_fault.json"
"""The loop's last fault, its time, and a device's report of it; also after a reset."""
MOST_WAITING_BYTES = 16 << 20
"""Bytes that may wait for the disk; further rows are dropped and counted."""


class SharedMemoryError(ExpectedError):
    """The rings of a run find no place; the message gives place, cause and next step."""


@contextmanager
def new_ring_folder() -> Iterator[Path]:
    """Give an empty ring folder, in shared memory where there is some; removed at the end.

    Those of processes that were killed are removed before. Raises SharedMemoryError.
    """
    place = shared_folder()
    remove_leftovers(place, PREFIX)
    with _room_in(place):
        folder = tempfile.TemporaryDirectory(
            prefix=f"{PREFIX}{os.getpid()}-", dir=place, ignore_cleanup_errors=True
        )
    with folder as name:
        yield Path(name)


@contextmanager
def _room_in(place: Path) -> Iterator[None]:
    try:
        yield
    except FileExistsError:
        raise
    except OSError as error:
        if error.errno in {errno.EMFILE, errno.ENFILE}:
            raise
        raise SharedMemoryError(
            f"{place}: the rings of a run find no place there: {error.strerror}; `df -h {place}` "
            "shows the free space, `sudo mount -o remount,rw,size=256m /dev/shm` or, for a "
            "container, `--shm-size=256m` gives more"
        ) from None


def publish(ring_folder: Path, topic: str, table: Sequence[Signal]) -> RingWriter:
    """Make a ring for a topic, and beside it the description by which readers find it.

    Raises SharedMemoryError, or FileExistsError for a topic that has one.
    """
    name = topic.strip("/").replace("/", "-")
    with _room_in(ring_folder.parent):
        ring = RingWriter(ring_folder / f"{name}.ring", len(table), RING_ROWS)
    description = {"topic": topic, "signals": [asdict(signal) for signal in table]}
    leave(ring_folder / f"{name}.topic", description)
    return ring


def published(ring_folder: Path, known: set[Path]) -> Iterator[tuple[str, list[Signal], Path]]:
    """Yield topic, table and ring of each description that is not yet `known`, and add it there."""
    for path in sorted(set(ring_folder.glob("*.topic")) - known):
        description = json.loads(path.read_text(encoding="utf-8"))
        known.add(path)
        table = [Signal(**signal) for signal in description["signals"]]
        yield description["topic"], table, path.with_suffix(".ring")


def describe(ring_folder: Path, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Describe the run for readers of the rings, as the metadata of a recording do."""
    leave(ring_folder / METADATA, metadata)


class Writer(Protocol):
    """The interface of a recorder's writer: `RecordingWriter`, or one that rotates."""

    def add_topic(self, topic: str, table: Sequence[Signal]) -> None:
        """Declare a topic."""

    def write_rows(self, topic: str, rows: Rows, numbers: Iterable[int] | None = None) -> None:
        """Append rows (n, columns of the topic's table); `numbers` (n,) count them from 1."""

    def flush(self) -> None:
        """Hand over the written bytes."""

    def close(self) -> None:
        """Finish the file."""

    @property
    def problem(self) -> str:
        """The disk's last error."""

    @property
    def waiting_bytes(self) -> int:
        """How much the disk has not taken yet."""

    @property
    def size_bytes(self) -> int:
        """How long the file is."""


def description(ring_folder: Path) -> dict[str, dict[str, str]] | None:
    """Return the description written by `describe`, None before."""
    path = ring_folder / METADATA
    if not path.is_file():
        return None
    found: dict[str, dict[str, str]] = json.loads(path.read_text(encoding="utf-8"))
    return found


class Recorder:
    """Writes every ring of a ring folder into one recording."""

    def __init__(
        self,
        ring_folder: Path,
        writer: Writer,
        watchers: Mapping[str, Callable[[Rows], None]] | None = None,
    ) -> None:
        """Record into `writer`; `watchers` see the new rows of a topic as they are written.

        Where a recorder of this folder has ended before, this one goes on where that one had
        come to: the rings still hold the rows that it had not brought to the disk.
        """
        self._ring_folder = ring_folder
        self.writer = writer
        self._watchers = watchers or {}
        self._known: set[Path] = set()
        self._readers: dict[str, RingReader] = {}
        self._refused: dict[str, int] = {}
        before = found(ring_folder / RECORDER_STATE) or {"dropped": {}, "recorded": {}}
        self.dropped_before: dict[str, int] = before["dropped"]
        self._recorded: dict[str, int] = before["recorded"]

    def discover(self) -> None:
        """Take in topics that were published since the last call."""
        for topic, table, ring in published(self._ring_folder, self._known):
            reader = self._readers[topic] = RingReader(ring)
            reader.go_on_after(self._recorded.get(topic, 0))
            self._refused[topic] = 0
            self.writer.add_topic(topic, table)

    def drain(self) -> int:
        """Write the rows since the last call; returns their number.

        While too much waits for the disk, rows are dropped and counted; watchers see them still.
        """
        written = 0
        for topic, reader in self._readers.items():
            numbers, rows = reader.read_numbered()
            if self.writer.waiting_bytes > MOST_WAITING_BYTES:
                self._refused[topic] += len(rows)
            else:
                self.writer.write_rows(topic, rows, numbers.tolist())
                written += len(rows)
            if len(rows) and topic in self._watchers:
                self._watchers[topic](rows)
        return written

    def flush(self) -> None:
        """Hand the written bytes to the operating system, so that a crash does not lose them."""
        self.writer.flush()
        if not self.writer.waiting_bytes:
            self._recorded |= {name: reader.last_read for name, reader in self._readers.items()}

    @property
    def dropped(self) -> dict[str, int]:
        """Rows lost by topic: the writer was faster than this reader, or the disk refused them."""
        now = {name: reader.dropped + self._refused[name] for name, reader in self._readers.items()}
        return self.dropped_before | {
            name: lost + self.dropped_before.get(name, 0) for name, lost in now.items()
        }

    @property
    def alarm(self) -> str:
        """The problem of the recording, as a sentence; empty without one."""
        if not self.writer.problem:
            return ""
        return (
            f"the disk refuses the recording ({self.writer.problem}): make room; "
            f"{self.writer.waiting_bytes >> 10} KiB wait in memory, then rows are dropped"
        )

    def publish_state(self) -> None:
        """Write this recorder's state for the status into the ring folder."""
        content = {
            "stamp_ns": time.monotonic_ns(),
            "dropped": self.dropped,
            "alarm": self.alarm,
            "bytes": self.writer.size_bytes,
            "recorded": self._recorded,
        }
        leave(self._ring_folder / RECORDER_STATE, content)

    def close(self) -> None:
        """Write the remaining rows, and finish the file."""
        self.discover()
        self.drain()
        self.writer.close()
