"""The data of every browser: read once, kept for a window of time, handed to each in part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.gaps import Breaker
from teleop_rt.view.live.health import Health, health
from teleop_rt.view.live.source import About, RecordingSource, RowSource

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

SHOWN_HZ = 100.0
"""Points a second of a curve; faster ones are thinned."""
PARAMETERS_HZ = 20.0
"""So many rows a second are sent on: a plot of ten seconds is about a thousand pixels wide, and
parameters move slowly."""
_SHOWN = {
    "/slave": frozenset(
        {
            "stamp_ns",
            "force",
            "predicted_force",
            "filtered_force",
            "position",
            "target",
            "surface",
        }
    ),
    "/master": frozenset({"stamp_ns", "rendered_force"}),
}
_JUDGED = {
    "/slave": frozenset(
        {
            "stamp_ns",
            "tick",
            "state",
            "fault",
            "missing",
            "selected",
            "inadequate",
            "in_contact",
            "force",
            "position",
            "filtered_force",
            "predicted_force",
            "wake_latency_us",
            "work_us",
            "model_sequence",
            "packets_rejected",
        }
    ),
    "/master": frozenset(
        {
            "stamp_ns",
            "state",
            "silence_ms",
            "trouble",
            "model_sequence",
            "packets_lost",
            "packets_received",
            "packets_rejected",
            "refused_models",
            "freezes",
            "declutches",
        }
    ),
}
"""Columns of a row that are kept: copying all fifty would occupy a core."""
_JUDGED_S = 10.0
"""Time over which the residual is judged."""
_MOST_PIECES = 100
"""Pieces that wait before they are joined."""


class Window:
    """The last rows of a topic, and how many there ever were."""

    def __init__(self, length_s: float) -> None:
        self._length_s = length_s
        self._pieces: list[Columns] = []
        self.count = 0

    def take(self, rows: Columns) -> None:
        """Append rows; rows older than the window are dropped at the next read."""
        self.count += rows["stamp_ns"].size
        self._pieces.append(rows)
        if len(self._pieces) > _MOST_PIECES:
            self._join()

    @property
    def columns(self) -> Columns:
        """The rows of the window; nothing before the first."""
        if len(self._pieces) > 1:
            self._join()
        return self._pieces[0] if self._pieces else {}

    @property
    def size(self) -> int:
        """How many rows the window holds."""
        return self.columns["stamp_ns"].size if self._pieces else 0

    def between(self, first: int, last: int) -> Columns:
        """Return the rows after the first `first` of all, up to `last`, as far as still held."""
        held = self.columns
        dropped = self.count - self.size
        return {n: v[max(first - dropped, 0) : max(last - dropped, 0)] for n, v in held.items()}

    def _join(self) -> None:
        joined = {n: np.concatenate([piece[n] for piece in self._pieces]) for n in self._pieces[0]}
        oldest_ns = joined["stamp_ns"][-1] - self._length_s * 1e9
        first = int(np.searchsorted(joined["stamp_ns"], oldest_ns))
        self._pieces = [{name: values[first:] for name, values in joined.items()}]


@dataclass(slots=True)
class Thinner:
    """Keeps one row in `step`, on one grid through all calls."""

    step: int
    phase: int = 0

    def __call__(self, rows: Columns) -> Columns:
        """Return the rows that are shown."""
        size = rows["stamp_ns"].size
        first = (-self.phase) % self.step
        self.phase = (self.phase + size) % self.step
        return {name: values[first :: self.step] for name, values in rows.items()}


class Feed:
    """One reader for all browsers; `poll()` takes the new rows."""

    def __init__(self, source: RowSource, window_s: float) -> None:
        self.source = source
        self.window_s = window_s
        self.shown: dict[str, Window] = {}
        self.health = Health()
        self.start_ns: float | None = None
        self._about: About | None = None
        self._judged: dict[str, Window] = {}
        self._thinners: dict[str, Thinner] = {}
        self._breakers: dict[str, Breaker] = {}

    @property
    def about(self) -> About | None:
        """Description of the run, None while it is not known yet."""
        if self._about is None:
            self._about = self.source.about()
        return self._about

    def ask(self, asked: Mapping[str, Any]) -> bool:
        """Take a page's request for a recording's playback; return whether all is to be sent again.

        A running slave is never asked anything: the page controls nothing.
        """
        if not isinstance(self.source, RecordingSource):
            return False
        place_s = self.source.playback.change(asked)
        if place_s is None:
            return False
        self._seek(self.source, place_s)
        return True

    def again(self) -> bool:
        """Restart a looped recording that has ended; return whether it was restarted."""
        source = self.source
        ended = isinstance(source, RecordingSource) and source.ended and source.playback.loops
        if ended and isinstance(source, RecordingSource):
            self._seek(source, 0.0)
        return ended

    def _seek(self, source: RecordingSource, place_s: float) -> None:
        source.seek(place_s, max(self.window_s, _JUDGED_S))
        self.shown.clear()
        self._judged.clear()
        self._thinners.clear()
        self._breakers.clear()
        self.health = Health()

    def poll(self) -> None:
        """Take the rows since the last call."""
        about = self.about
        if about is None:
            return
        for topic, rows in self.source.read().items():
            if topic == "/slave" and self.start_ns is None:
                self.start_ns = float(rows["stamp_ns"][0])
            thinner = self._thinners.setdefault(topic, Thinner(_step(about, topic)))
            thin = thinner(_only(_SHOWN.get(topic), rows))
            if thin["stamp_ns"].size:
                breaker = self._breakers.setdefault(topic, Breaker())
                self.shown.setdefault(topic, Window(self.window_s)).take(breaker(thin))
            if topic in _JUDGED:
                judged = self._judged.setdefault(topic, Window(_JUDGED_S))
                judged.take(_only(_JUDGED[topic], rows))

    def judge(self) -> None:
        """Bring everything that has a lamp up to date, from the last ten seconds."""
        if self.about is not None and "/slave" in self._judged:
            columns = {topic: window.columns for topic, window in self._judged.items()}
            self.health = health(self.about, columns, self.health)


def _step(about: About, topic: str) -> int:
    """Return of how many rows of a topic one is shown; estimators are recorded in turn."""
    if topic.startswith("/estimates/"):
        return max(1, round(1.0 / (about.period_s * len(about.rows) * PARAMETERS_HZ)))
    return max(1, round(1.0 / (about.period_s * SHOWN_HZ)))


def _only(names: frozenset[str] | None, rows: Columns) -> Columns:
    """Return the named columns, as far as there are such; all where no names are given."""
    return rows if names is None else {n: values for n, values in rows.items() if n in names}
