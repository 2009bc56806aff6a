"""The frames for all browsers, composed once from the data of the feed."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Mapping
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.live import words
from teleop_rt.view.live.feed import Columns, Feed, Window
from teleop_rt.view.live.health import Lamp
from teleop_rt.view.live.plots import MOST_PARAMETERS, SOURCES
from teleop_rt.view.live.source import About, RecordingSource
from teleop_rt.view.quantities import SMALL, parameter_unit, small
from teleop_rt.view.residual import Whiteness
from teleop_rt.view.style import method_name, model_name

Array = NDArray[np.float64]
_FRAMES_PER_TURN = 5
"""Residual, parameters and words change in every fifth frame: nobody reads them faster."""
_PARAMETERS_TURN, _WORDS_TURN, _RESIDUAL_TURN = 0, 2, 4
"""Contents of each of five frames: all in one would delay the curves, which move in each."""
_FAST = ("slave", "master")
_TOPICS = {"slave": "/slave", "residual": "/slave", "master": "/master"}
_ESTIMATE = "estimate "
"""Name of the source of an estimator's parameters, before the number of its row."""
_LEAST_MM = 1.0
"""Least height of the position's axis, so that noise at rest does not fill it."""
_WIDEST_BAND_SHARE = 0.1
"""Edges of a band wider than this share of its value do not stretch the axis: how the value moves
would be hidden. The band itself is always drawn whole."""


class Frames:
    """Frames as JSON text: `next()` for who saw the one before it, `whole()` for who did not.

    A frame is `{words: {id: html}, plots: {name: {label, least}}, sources: {name: {replace, keep,
    columns: {name: base64 of little-endian float64}}}}`, with `estimators: {selected, names,
    parameters: {row: [{title, label}]}}` when these change, and of a recording with the place of
    its `playback`. A frame with everything has the key `whole`.
    """

    def __init__(self, feed: Feed) -> None:
        self._feed = feed
        self._sent: dict[str, int] = {}
        self._sent_entries: dict[str, Any] = {}
        self.chosen: frozenset[int] = frozenset()
        """Rows of the estimators that browsers look at beside the selected one."""
        self._white: Whiteness | None = None
        self._count = 0

    def forget(self) -> None:
        """Reset: the recording continues from another place."""
        self._sent.clear()
        self._sent_entries.clear()
        self._white = None

    def next(self, note: str = "") -> str:
        """Return the changes since the last call; `note` is a message to every browser."""
        turn = self._count % _FRAMES_PER_TURN
        self._count += 1
        sources: dict[str, Any] = {}
        self._take_new(_FAST, sources)
        entries: dict[str, Any] = {}
        if turn == _PARAMETERS_TURN:
            entries = self._plots() | self._estimators()
            self._take_new(self._estimates(), sources)
        elif turn == _WORDS_TURN:
            entries = self._words(note)
        elif turn == _RESIDUAL_TURN:
            self._take_new(("residual",), sources)
            if self._feed.health.whiteness is not self._white:
                self._white = self._feed.health.whiteness
                sources["correlation"] = _correlation(self._white)
        new = {key: value for key, value in entries.items() if self._sent_entries.get(key) != value}
        self._sent_entries |= new
        return _text(new, sources, self._place() if turn == _WORDS_TURN else {})

    def _take_new(self, names: Iterable[str], sources: dict[str, Any]) -> None:
        """Put into `sources` the rows of each that nobody was sent yet."""
        for name in names:
            window = self._window(name)
            first = self._sent.get(name, 0)
            if window is not None and window.count > first:
                sources[name] = self._rows(name, window, first, window.count)
                self._sent[name] = window.count

    def whole(self, note: str = "") -> str:
        """Return all that `next()` has sent so far, as far as it is still shown."""
        sources = {"correlation": _correlation(self._white)}
        for name, last in self._sent.items():
            window = self._window(name)
            if window is not None:
                sources[name] = self._rows(name, window, 0, last)
        entries = self._sent_entries | self._words(note) | self._plots() | self._estimators()
        return _text(entries, sources, {"whole": True} | self._place())

    def _place(self) -> dict[str, Any]:
        """Return where the playback of a recording is; nothing of a running slave."""
        source = self._feed.source
        if not isinstance(source, RecordingSource) or source.length_s is None:
            return {}
        playback = source.playback
        place_s = min(playback.place_s, source.length_s)
        entries = {"place_s": place_s, "length_s": source.length_s, "speed": playback.speed}
        return {"playback": entries | {"playing": playback.playing, "loops": playback.loops}}

    def _window(self, name: str) -> Window | None:
        about = self._feed.about
        if not name.startswith(_ESTIMATE):
            return self._feed.shown.get(_TOPICS[name])
        row = int(name.removeprefix(_ESTIMATE))
        return None if about is None else self._feed.shown.get(_topic(about, row))

    def _estimates(self) -> list[str]:
        """Return the sources of the selected estimators; drop those of the others."""
        about = self._feed.about
        known = range(len(about.rows)) if about is not None else ()
        looked_at = {self._feed.health.selected, *self.chosen}
        names = [f"{_ESTIMATE}{row}" for row in known if row in looked_at]
        for name in [one for one in self._sent if one.startswith(_ESTIMATE) and one not in names]:
            del self._sent[name]
        return names

    def _estimators(self) -> dict[str, Any]:
        """Return the estimators by name, the selected one, and the parameters of those shown."""
        about = self._feed.about
        if about is None:
            return {}
        entries = {
            "selected": self._feed.health.selected,
            "names": [f"{model_name(row[0])}, {method_name(*row[1:])}" for row in about.rows],
            "parameters": {
                name.removeprefix(_ESTIMATE): self._parameters(about, name)
                for name in self._estimates()
            },
        }
        return {"estimators": entries}

    def _parameters(self, about: About, source: str) -> list[dict[str, str]]:
        """Return title and axis of each parameter of an estimator."""
        model, regression, solver = about.rows[int(source.removeprefix(_ESTIMATE))]
        window = self._window(source)
        units = about.position_unit, about.force_unit
        estimator = f"{model_name(model)}, {method_name(regression, solver)}"
        return [
            {
                "title": f"{name} of {estimator}; band: ± 2 σ",
                "label": f"{name} [{parameter_unit(model, name, *units)}]",
            }
            for name in ([] if window is None else _names(window.columns))
        ]

    def _rows(self, name: str, window: Window, first: int, last: int) -> dict[str, Any]:
        rows = window.between(first, last)
        columns = {"t": (rows["stamp_ns"] - (self._feed.start_ns or 0.0)) * 1e-9}
        if name == "residual":
            columns["residual"] = rows["filtered_force"] - rows["predicted_force"]
        elif name.startswith(_ESTIMATE):
            columns |= _bands(rows, _names(rows))
        else:
            scale = dict.fromkeys(("position", "target", "surface"), SMALL)
            columns |= {c: scale.get(c, 1.0) * rows[c] for c in SOURCES[name][1:]}
        return _packed(columns, replace=first == 0, keep=window.size)

    def _words(self, note: str) -> dict[str, Any]:
        about, found = self._feed.about, self._feed.health
        if about is None:
            return {"about": words.lamp(Lamp("unknown", "waiting for a run")), "note": note}
        source = self._feed.source
        name = "ended" if source.ended else source.name
        return {
            "about": f"<b>{escape(about.trial)}</b> {escape(about.rig)} · {escape(name)}",
            "values": words.values(found, about.position_unit, about.force_unit),
            "chain": words.chain(found.state),
            "fault": words.fault(found),
            "model": words.lamp(found.model),
            "loop": words.lamp(found.loop),
            "link": words.lamp(found.link),
            "note": escape(note),
        }

    def _plots(self) -> dict[str, Any]:
        """Return by plot the label of its axis, and its least height."""
        about = self._feed.about
        if about is None:
            return {}
        units = {"force": about.force_unit, "residual": about.force_unit}
        units["position"] = small(about.position_unit)
        entries: dict[str, Any] = {
            f"plot_{name}": {"label": f"{name} [{unit}]"} for name, unit in units.items()
        }
        for name in units:
            entries[f"plot_{name}"]["least"] = (
                _LEAST_MM if name == "position" else about.force_noise
            )
        return entries


def _names(columns: Iterable[str]) -> list[str]:
    """Return the parameters of an estimator by its recorded columns."""
    held = set(columns)
    names = [name for name in columns if f"{name}_std" in held and name != "offset"]
    return names[:MOST_PARAMETERS]


def _topic(about: About, row: int) -> str:
    return "/estimates/" + "/".join(about.rows[row])


def _bands(rows: Columns, names: list[str]) -> dict[str, Array]:
    """Return each parameter with two deviations either way; other values are left out."""
    unknown = np.isin(rows["status"], (0.0, 3.0))
    nothing = np.full(unknown.size, np.nan)
    columns = {}
    for place in range(MOST_PARAMETERS):
        known = place < len(names)
        values = np.where(unknown, np.nan, rows[names[place]]) if known else nothing
        spread = rows[f"{names[place]}_std"] if known else nothing
        edge = np.where(spread > _WIDEST_BAND_SHARE * np.abs(values), np.nan, spread)
        columns[f"p{place}"] = values
        columns[f"low{place}"], columns[f"high{place}"] = values - 2 * spread, values + 2 * spread
        columns[f"low_edge{place}"] = values - 2 * edge
        columns[f"high_edge{place}"] = values + 2 * edge
    return columns


def _correlation(white: Whiteness | None) -> dict[str, Any]:
    if white is None:
        return _packed({name: np.empty(0) for name in SOURCES["correlation"]}, replace=True, keep=0)
    spacing_ms = 1e3 * white.spacing_s
    lags = spacing_ms * np.arange(1, white.correlation.size + 1)
    columns = {
        "lag": lags,
        "width": np.full(lags.size, 0.5 * spacing_ms),
        "value": white.correlation,
        "bound": np.full(lags.size, white.bound),
        "other_bound": np.full(lags.size, -white.bound),
    }
    return _packed(columns, replace=True, keep=lags.size)


def _packed(columns: Mapping[str, Array], *, replace: bool, keep: int) -> dict[str, Any]:
    packed = {
        name: base64.b64encode(values.astype("<f8").tobytes()).decode()
        for name, values in columns.items()
    }
    return {"replace": replace, "keep": keep, "columns": packed}


def _text(entries: Mapping[str, Any], sources: Mapping[str, Any], place: dict[str, Any]) -> str:
    parts: dict[str, Any] = {"words": {}, "plots": {}, "sources": sources} | place
    for name, content in entries.items():
        if name == "estimators":
            parts[name] = content
        else:
            parts["plots" if name.startswith("plot_") else "words"][name] = content
    return json.dumps(parts, allow_nan=False)
