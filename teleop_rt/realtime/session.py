"""A session: the folder in shared memory where the processes of a run publish their rings."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path

from teleop_rt.realtime.recording import RecordingWriter, Rows
from teleop_rt.realtime.ring import RingReader, RingWriter
from teleop_rt.signals import Signal

PREFIX = "teleop-rt-"
METADATA = "run.metadata"
_CAPACITY = 8192
RECORDER_STATE = "recorder.json"
"""What the recorder says of itself: rows dropped, and whether the disk refuses anything."""
MOST_WAITING_BYTES = 16 << 20
"""What may wait for the disk; rows that come while more than that waits are dropped, counted."""


def shared_folder() -> Path:
    """Return where sessions lie: in shared memory, where there is some."""
    shared = Path("/dev/shm")  # noqa: S108 - the kernel's shared memory, no file to guess
    return shared if shared.is_dir() else Path(tempfile.gettempdir())


@contextmanager
def new_session() -> Iterator[Path]:
    """Give an empty session folder, in shared memory where there is some; removed at the end."""
    with tempfile.TemporaryDirectory(
        prefix=f"{PREFIX}{os.getpid()}-", dir=shared_folder(), ignore_cleanup_errors=True
    ) as name:
        yield Path(name)


def publish(session: Path, topic: str, table: Sequence[Signal]) -> RingWriter:
    """Make a ring for a topic, and beside it the description by which readers find it."""
    name = topic.strip("/").replace("/", "-")
    ring = RingWriter(session / f"{name}.ring", len(table), _CAPACITY)
    description = {"topic": topic, "signals": [asdict(signal) for signal in table]}
    unfinished = session / f"{name}.part"
    unfinished.write_text(json.dumps(description), encoding="utf-8")
    unfinished.rename(session / f"{name}.topic")
    return ring


def describe(session: Path, metadata: Mapping[str, Mapping[str, str]]) -> None:
    """Tell readers of the rings what runs, in the words that a recording of it carries."""
    unfinished = session / f"{METADATA}.part"
    unfinished.write_text(json.dumps(metadata), encoding="utf-8")
    unfinished.rename(session / METADATA)


def description(session: Path) -> dict[str, dict[str, str]] | None:
    """Return what was told by `describe`, None before."""
    path = session / METADATA
    if not path.is_file():
        return None
    found: dict[str, dict[str, str]] = json.loads(path.read_text(encoding="utf-8"))
    return found


class Recorder:
    """Writes every ring of a session into one recording."""

    def __init__(
        self,
        session: Path,
        writer: RecordingWriter,
        watchers: Mapping[str, Callable[[Rows], None]] | None = None,
    ) -> None:
        """Record into `writer`; `watchers` see the new rows of a topic as they are written."""
        self._session = session
        self._writer = writer
        self._watchers = watchers or {}
        self._readers: dict[str, RingReader] = {}
        self._refused: dict[str, int] = {}

    def discover(self) -> None:
        """Take in topics that were published since the last call."""
        for path in sorted(self._session.glob("*.topic")):
            description = json.loads(path.read_text(encoding="utf-8"))
            if description["topic"] in self._readers:
                continue
            table = [Signal(**signal) for signal in description["signals"]]
            self._readers[description["topic"]] = RingReader(path.with_suffix(".ring"))
            self._refused[description["topic"]] = 0
            self._writer.add_topic(description["topic"], table)

    def drain(self) -> int:
        """Write what has come since the last call; returns the number of rows.

        While too much waits for the disk, rows are dropped and counted; watchers see them still.
        """
        written = 0
        for topic, reader in self._readers.items():
            rows = reader.read()
            if self._writer.waiting_bytes > MOST_WAITING_BYTES:
                self._refused[topic] += len(rows)
            else:
                self._writer.write_rows(topic, rows)
                written += len(rows)
            if len(rows) and topic in self._watchers:
                self._watchers[topic](rows)
        return written

    def flush(self) -> None:
        """Hand what was written to the operating system, so that a crash loses no more."""
        self._writer.flush()

    @property
    def dropped(self) -> dict[str, int]:
        """Rows lost by topic: the writer was faster than this reader, or the disk refused them."""
        return {
            name: reader.dropped + self._refused[name] for name, reader in self._readers.items()
        }

    @property
    def alarm(self) -> str:
        """What is wrong with the recording, as a sentence; empty while nothing is."""
        if not self._writer.problem:
            return ""
        return (
            f"the disk refuses the recording ({self._writer.problem}): make room; "
            f"{self._writer.waiting_bytes >> 10} KiB wait in memory, then rows are dropped"
        )

    def publish_state(self) -> None:
        """Leave in the session what readers of the status want to know of this recorder."""
        content = {"dropped": self.dropped, "alarm": self.alarm, "bytes": self._writer.size_bytes}
        unfinished = self._session / f"{RECORDER_STATE}.part"
        unfinished.write_text(json.dumps(content), encoding="utf-8")
        unfinished.rename(self._session / RECORDER_STATE)

    def close(self) -> None:
        """Write what is left, and finish the file."""
        self.discover()
        self.drain()
        self._writer.close()
