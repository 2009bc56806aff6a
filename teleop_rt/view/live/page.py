"""One browser's page: it takes from the feed what it has not seen, some 25 times a second."""

from __future__ import annotations

import time
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.models import ColumnDataSource, InlineStyleSheet
from bokeh.models.widgets.markups import Div
from numpy.typing import NDArray

from teleop_rt.view.live import words
from teleop_rt.view.live.feed import Feed
from teleop_rt.view.live.health import Lamp
from teleop_rt.view.live.plots import Curve, Parameters, Plot, correlation_plot
from teleop_rt.view.live.source import About
from teleop_rt.view.style import Palette

Array = NDArray[np.float64]
_WORDS_S = 0.2
_SLAVE = ("force", "predicted_force", "position", "target", "surface", "residual")
_MASTER = ("rendered_force",)


class Page:
    """The models of one document and what it has been sent so far."""

    def __init__(
        self, document: Document, feed: Feed, palette: Palette, pace_s: Callable[[], float]
    ) -> None:
        """Add the roots to the document; `pace_s` says how long to wait between two frames."""
        self._feed, self._pace_s = feed, pace_s
        self._sources = {
            "slave": ColumnDataSource({name: [] for name in ("t", *_SLAVE)}, name="slave"),
            "master": ColumnDataSource({name: [] for name in ("t", *_MASTER)}, name="master"),
        }
        sheet = InlineStyleSheet(css=words.CSS)
        self._words = {
            name: Div(name=name, text="", sizing_mode="stretch_width", stylesheets=[sheet])
            for name in ("about", "values", "chain", "fault", "model", "loop", "link", "frames")
        }
        self._parameters = Parameters(palette, feed.window_s)
        correlation, self._correlation, self._bounds = correlation_plot(palette)
        self._plots = self._make_plots(palette)
        self._seen: dict[str, int] = {}
        self._sent_s = self._told_s = 0.0
        self._frames, self._counted_s = 0, time.monotonic()
        for root in (
            *self._words.values(),
            *(plot.figure for plot in self._plots),
            *self._parameters.figures,
            correlation,
        ):
            document.add_root(root)

    def _make_plots(self, p: Palette) -> list[Plot]:
        force = [
            ("slave", Curve("force", "measured", p.measured, width=2.5)),
            ("slave", Curve("predicted_force", "predicted", p.predicted, "dashed")),
            ("master", Curve("rendered_force", "rendered", p.rendered)),
        ]
        position = [
            ("slave", Curve("target", "asked for", p.target, width=2.5)),
            ("slave", Curve("position", "x measured", p.measured)),
            ("slave", Curve("surface", "surface", p.predicted, "dashed")),
        ]
        residual = [("slave", Curve("residual", "measured - predicted", p.residual, width=1.5))]
        window_s, sources = self._feed.window_s, self._sources
        return [
            Plot("force", "force", p, window_s, sources, force, height=280),
            Plot("position", "position", p, window_s, sources, position),
            Plot("residual", "residual", p, window_s, sources, residual),
        ]

    def update(self) -> None:
        """Send what is new; called by the server at its own pace."""
        now_s = time.monotonic()
        about = self._feed.about
        if about is None:
            self._words["about"].text = words.lamp(Lamp("unknown", "waiting for a run"))
            return
        if "paused" in self._words["frames"].tags:
            self._words["frames"].text = '<span class="faint">paused</span>'
            return
        if now_s - self._sent_s < self._pace_s():
            return
        self._sent_s = now_s
        self._frames += 1
        self._stream("slave", "/slave")
        self._stream("master", "/master")
        self._stream_parameters(about)
        if now_s - self._told_s >= _WORDS_S:
            self._told_s = now_s
            self._tell(about, now_s)

    def _stream(self, source: str, topic: str) -> None:
        window = self._feed.shown.get(topic)
        if window is None or self._feed.start_ns is None:
            return
        columns = window.since(self._seen.get(topic, 0))
        self._seen[topic] = window.count
        if not columns or not columns["stamp_ns"].size:
            return
        names = _SLAVE if source == "slave" else _MASTER
        new: dict[str, Any] = {name: columns[name] for name in names if name != "residual"}
        if source == "slave":
            new["residual"] = columns["filtered_force"] - columns["predicted_force"]
        new["t"] = (columns["stamp_ns"] - self._feed.start_ns) * 1e-9
        self._sources[source].stream(new, window.size)

    def _stream_parameters(self, about: About) -> None:
        selected = self._feed.health.selected
        if selected < 0 or self._feed.start_ns is None:
            return
        topic = "/estimates/" + "/".join(about.rows[selected])
        window = self._feed.shown.get(topic)
        if window is None:
            return
        if selected != self._parameters.row:
            self._parameters.select(about, selected, window.columns)
            self._seen[topic] = 0
        columns = window.since(self._seen.get(topic, 0))
        self._seen[topic] = window.count
        if columns and columns["stamp_ns"].size:
            t = (columns["stamp_ns"] - self._feed.start_ns) * 1e-9
            self._parameters.stream(columns, t, window.size)

    def _tell(self, about: About, now_s: float) -> None:
        """Bring the words up to date; what has not changed is not sent again."""
        found, ended = self._feed.health, self._feed.source.ended
        name = "ended" if ended else self._feed.source.name
        text = {
            "about": f"<b>{escape(about.trial)}</b> {escape(about.rig)} · {escape(name)}",
            "values": words.values(found, about.position_unit, about.force_unit),
            "chain": words.chain(found.state),
            "fault": words.fault(found),
            "model": words.lamp(found.model),
            "loop": words.lamp(found.loop),
            "link": words.lamp(found.link),
        }
        if now_s - self._counted_s >= 1.0:
            rate = self._frames / (now_s - self._counted_s)
            text["frames"] = f'<span class="faint">{rate:.0f} frames/s</span>'
            self._frames, self._counted_s = 0, now_s
        for key, value in text.items():
            if self._words[key].text != value:
                self._words[key].text = value
        self._units(about)
        if found.whiteness is not None:
            white = found.whiteness
            lags = 1e3 * white.spacing_s * np.arange(1, white.correlation.size + 1)
            self._correlation.data = {"lag": lags, "value": white.correlation}
            for bound, sign in zip(self._bounds, (-1.0, 1.0), strict=True):
                bound.location = sign * white.bound

    def _units(self, about: About) -> None:
        units = (about.force_unit, about.position_unit, about.force_unit)
        for plot, unit in zip(self._plots, units, strict=True):
            label = f"{plot.figure.name} [{unit}]"
            if plot.figure.yaxis.axis_label != label:
                plot.figure.yaxis.axis_label = label
