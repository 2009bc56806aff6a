"""Where the live page's rows come from: the rings of a run, or a recording played back."""

from __future__ import annotations

import json
import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from teleop_rt.errors import RecordingError
from teleop_rt.realtime.leftovers import alive, owner, shared_folder
from teleop_rt.realtime.mcap_index import time_span
from teleop_rt.realtime.parent import end_with_parent
from teleop_rt.realtime.reading import read_messages, read_metadata
from teleop_rt.realtime.recording import ONLINE, RUN, SIMULATED
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.ring_folder import PREFIX, description, published
from teleop_rt.service.place import places
from teleop_rt.trial.folder import recording_of
from teleop_rt.view.live.playback import Playback

Array = NDArray[np.float64]
Columns = Mapping[str, Array]
Row = Mapping[str, float | None]
_AHEAD_NS = 1e9
"""Topics lie in a recording in pieces, one after the other: so far apart are rows of one time."""


@dataclass(frozen=True, slots=True)
class About:
    """Description of a run or a recording."""

    trial: str
    rig: str
    position_unit: str
    force_unit: str
    rows: tuple[tuple[str, str, str], ...]
    period_s: float
    force_noise: float
    cutoff_hz: float
    simulated: bool = False


class RowSource(Protocol):
    """Gives the new rows of each topic."""

    name: str

    def about(self) -> About | None:
        """Return the description of the run, None while it is not known yet."""

    def topics(self) -> dict[str, list[str]]:
        """Return the names of the signals of each topic known so far."""

    def read(self) -> dict[str, Columns]:
        """Return the rows that came since the last call, by topic."""

    @property
    def ended(self) -> bool:
        """True once nothing more will come."""


class RingSource:
    """The rings of a running slave, mapped read-only: reading them costs the loop nothing."""

    def __init__(self, find: Callable[[], Path | None]) -> None:
        """Read the ring folder that `find` returns, as soon as it returns one."""
        self.name = "live"
        self._find = find
        self._ring_folder = find()
        self._known: set[Path] = set()
        self._readers: dict[str, tuple[RingReader, list[str]]] = {}

    def about(self) -> About | None:
        """Return the description of the run, None until the slave has published it."""
        self._ring_folder = self._ring_folder or self._find()
        if self._ring_folder is None:
            return None
        metadata = description(self._ring_folder)
        return None if metadata is None else about_of(metadata)

    def topics(self) -> dict[str, list[str]]:
        """Return the names of the signals of each topic known so far."""
        self._discover()
        return {topic: names for topic, (_, names) in self._readers.items()}

    def read(self) -> dict[str, Columns]:
        """Return the rows that came since the last call, by topic."""
        self._discover()
        found: dict[str, Columns] = {}
        for topic, (reader, names) in self._readers.items():
            rows = reader.read()
            if len(rows):
                found[topic] = dict(zip(names, rows.T, strict=True))
        return found

    @property
    def ended(self) -> bool:
        """True once the slave has closed its ring."""
        slave = self._readers.get("/slave")
        return slave is not None and slave[0].closed

    def _discover(self) -> None:
        for topic, table, ring in (
            published(self._ring_folder, self._known) if self._ring_folder else ()
        ):
            if ring.exists():
                self._readers[topic] = RingReader(ring), [signal.name for signal in table]


class RecordingSource:
    """A recording of whatever length; its first read begins to play it, at its own pace."""

    def __init__(self, path: Path, now_s: Callable[[], float], *, speed: float = 1.0) -> None:
        """Read its beginning. Raises RecordingError where it is no recording of a slave."""
        self.name = f"replay of {path.name}"
        self._about = about_of({name: read_metadata(path, name) for name in (ONLINE, RUN)})
        self._path = path
        self.playback = Playback(now_s, speed)
        self.length_s = _length_s(path)
        self._topics: dict[str, list[str]] = {}
        self._rewind(0.0)
        while not self._ahead.get("/slave"):
            if not self._take():
                raise RecordingError(f"{path}: has no tick of a slave: give the recording of a run")
        self._first_ns = float(self._ahead["/slave"][0]["stamp_ns"] or 0.0)
        self._read_until(self._first_ns)

    def _rewind(self, from_ns: float) -> None:
        """Begin to read the file again, leaving out rows before a stamp."""
        self._messages = _rows_of(self._path, from_ns)
        self._ahead: dict[str, deque[Row]] = {}
        self._newest_ns = -np.inf
        self._exhausted = False

    def seek(self, place_s: float, window_s: float) -> None:
        """Continue from a place [s], with the rows of a window before it.

        The clock starts once these have been read: it would run ahead of a slow disk.
        """
        length_s = self.length_s or math.inf
        place_s = min(max(0.0, place_s), length_s)
        self._rewind(self._first_ns + (place_s - window_s) * 1e9)
        self._read_until(self._first_ns + place_s * 1e9)
        self.playback.move(place_s)

    def about(self) -> About | None:
        """Return the description of the run."""
        return self._about

    def topics(self) -> dict[str, list[str]]:
        """Return the names of the signals of each topic known so far."""
        return self._topics

    def read(self) -> dict[str, Columns]:
        """Return the rows whose time has come since the last call, by topic."""
        until_ns = self._first_ns + self.playback.place_s * 1e9
        self._read_until(until_ns)
        found: dict[str, Columns] = {}
        for topic, ahead in self._ahead.items():
            rows = []
            while ahead and (ahead[0]["stamp_ns"] or 0.0) <= until_ns:
                rows.append(ahead.popleft())
            if rows:
                found[topic] = {
                    name: np.array([row[name] for row in rows], dtype=np.float64)
                    for name in rows[0]
                }
        return found

    @property
    def ended(self) -> bool:
        """True once the whole recording has been played."""
        return self._exhausted and not any(self._ahead.values())

    def _read_until(self, stamp_ns: float) -> None:
        while self._newest_ns < stamp_ns + _AHEAD_NS and self._take():
            pass

    def _take(self) -> bool:
        """Read one row ahead; False at the end of the file."""
        found = next(self._messages, None)
        if found is None:
            self._exhausted = True
            return False
        topic, row = found
        if topic not in self._ahead:
            self._ahead[topic] = deque()
            self._topics[topic] = list(row)
        self._ahead[topic].append(row)
        self._newest_ns = max(self._newest_ns, row["stamp_ns"] or 0.0)
        return True


def _rows_of(path: Path, from_ns: float) -> Iterator[tuple[str, Row]]:
    """Give the rows of a recording in the order of the file, those from a stamp on."""
    for topic, text in read_messages(path, ["/slave", "/master", "/estimates/"], from_ns):
        yield topic, json.loads(text)


def _length_s(path: Path) -> float | None:
    """Return how long a recording is [s] by its index; None where it was cut off."""
    span = time_span(path)
    return None if span is None else (span[1] - span[0]) * 1e-9


def about_of(metadata: Mapping[str, Mapping[str, str] | None]) -> About | None:
    """Return the description in the metadata of a recording or a run, None without one."""
    online, run = metadata.get(ONLINE), metadata.get(RUN) or {}
    if online is None:
        return None
    settings = json.loads(online["settings"])
    return About(
        trial=run.get("trial", ""),
        rig=run.get("rig", ""),
        position_unit=online["position_unit"],
        force_unit=online["force_unit"],
        rows=tuple(tuple(row) for row in json.loads(online["rows"])),
        period_s=float(settings["period_s"]),
        force_noise=float(settings["force_noise"]),
        cutoff_hz=float(settings["cutoff_hz"]),
        simulated=SIMULATED in run,
    )


def announce(name: str, address: str) -> None:
    """Print the address of the page."""
    print(f"{name}: open {address} (end with Ctrl-C)", flush=True)


def open_source(recording: Path | None, beside: int | None = None) -> RowSource:
    """Return a recording or run folder, the run of the process `beside`, or the newest run.

    Raises RecordingError where there is none.
    """
    if recording is not None:
        return RecordingSource(recording_of(recording), time.monotonic)
    if beside is not None:
        end_with_parent()
        if os.getppid() != beside:  # it died while this process was still loading
            raise RecordingError(
                f"the run of process {beside} has ended"
                ": `teleop-rt live FOLDER` shows its recording"
            )
        return RingSource(lambda: find_ring_folder(beside))
    found = find_ring_folder()
    if found is None:
        raise RecordingError(
            "nothing runs on this machine that could be shown: start `teleop-rt run --live` or"
            " `teleop-rt slave TRIAL`, or name a recording (`teleop-rt live RECORDING`)"
        )
    return RingSource(lambda: found)


def find_ring_folder(pid: int | None = None) -> Path | None:
    """Return the newest ring folder of a process that lives (of `pid` if it is given), or None.

    A daemon, or a run that holds a rig, is found at its place in the run folder and comes first.
    """
    found = [path for path in _ring_folders() if pid is None or owner(path.name, PREFIX) == pid]
    placed = {place.ring_folder.resolve() for place in places()} if pid is None else set()
    first = [path for path in found if path.resolve() in placed] or found
    readable = [path for path in first if os.access(path, os.R_OK | os.X_OK)]
    if first and not readable:
        raise RecordingError(
            f"process {owner(first[0].name, PREFIX)} runs, and this user may not read its rings in"
            f" {first[0]}: look as {first[0].owner()}, or join the group {first[0].group()}"
        )
    return max(readable, key=lambda path: path.stat().st_mtime_ns, default=None)


def _ring_folders() -> Iterator[Path]:
    for path in shared_folder().glob(f"{PREFIX}*"):
        process = owner(path.name, PREFIX)
        if path.is_dir() and process is not None and alive(process):
            yield path
