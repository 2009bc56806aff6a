"""Charts on the screen: interactive Bokeh figures that need no server and no network."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.embed.util import standalone_docs_json_and_render_items
from bokeh.models import (
    ColumnDataSource,
    CrosshairTool,
    HoverTool,
    Range1d,
    RangeTool,
)
from bokeh.models.annotations.geometry import Span
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from bokeh.resources import Resources
from numpy.typing import NDArray

from teleop_rt.view.charts import Chart, Curve, Panel, kept_rows
from teleop_rt.view.style import IN_THE_DARK, LIGHT

Array = NDArray[np.float64]

_MOST_ROWS = 24_000  # per source: every tick of 24 s at 1 kHz, of a longer run the extremes
_STRIP_ROWS = 1_000  # of the strip, which is as wide as the page
_PANEL_PX, _STRIP_PX, _LONE_PX = 120, 56, 240
_LEFT_PX, _RIGHT_PX = 76, 8  # one margin for all: time axes of a page lie below each other
_FAINT = 0.35

Sources = dict[int, tuple[ColumnDataSource, str]]
"""Source and column of each curve, by the curve's identity."""


@dataclass(frozen=True, slots=True)
class Screen:
    """The parts of a page: the program, the figures as JSON, and the places of each chart."""

    program: str
    figures: str
    places: Mapping[str, Sequence[str]]


def screen(charts: Iterable[Chart]) -> Screen:
    """Return charts as figures; those of one `linked` name move together."""
    shared: dict[str, Range1d] = {}
    roots = {chart.name: list(_figures(chart, shared)) for chart in charts}
    plots = [plot for found in roots.values() for plot in found]
    if not plots:
        return Screen("", "", {})
    document = Document()
    with document.models.freeze():  # they are walked through once, not for every root
        for plot in plots:
            document.add_root(plot)
    documents, _ = standalone_docs_json_and_render_items(plots)
    (drawn,) = documents.values()
    places = {plot.id: f"screen-{plot.name}" for plot in plots}
    figures = {
        "documents": {"figures": drawn},
        "items": [{"docid": "figures", "roots": places, "root_ids": list(places)}],
        "dark": dict(IN_THE_DARK),
    }
    text = json.dumps(figures, separators=(",", ":")).replace("</", "<\\/")
    return Screen(
        program="\n".join(Resources(mode="inline", components=["bokeh"]).js_raw),
        figures=_renumbered(text),
        places={name: [places[plot.id] for plot in found] for name, found in roots.items()},
    )


def _renumbered(text: str) -> str:
    """Return the JSON of figures with ids in order: Bokeh goes on counting through a process."""
    order: dict[str, str] = {}
    return re.sub(r'"p\d+"', lambda one: order.setdefault(one[0], f'"p{1000 + len(order)}"'), text)


def script() -> str:
    """Return what shows the figures and answers to the buttons of a page."""
    return (files("teleop_rt.view") / "pages" / "screen.js").read_text(encoding="utf-8")


def _figures(chart: Chart, shared: dict[str, Range1d]) -> Iterator[figure]:
    x_range = _x_range(chart, shared)
    hair = Span(dimension="height", line_color=LIGHT.faint, line_width=0.7)
    sources = _sources(chart)
    last = len(chart.panels) - 1
    for place, panel in enumerate(chart.panels):
        own = chart.beside and place > 0
        label = panel.xlabel or (chart.xlabel if place == last or chart.beside else None)
        plot = _blank(chart, panel, None if own else x_range, label)
        plot.name = f"{chart.name}-{place}"
        _draw(plot, chart, panel, sources)
        if not own:
            plot.add_tools(CrosshairTool(overlay=hair))
        yield plot
    if chart.window is not None and x_range is not None:
        yield _strip(chart, x_range)


def _x_range(chart: Chart, shared: dict[str, Range1d]) -> Range1d | None:
    shown, whole = chart.window or chart.limits, chart.limits
    if shown is None:
        return None
    made = Range1d(start=shown[0], end=shown[1])
    if whole is not None and chart.window is not None:
        made.bounds = whole
    return shared.setdefault(chart.linked, made) if chart.linked else made


def _blank(chart: Chart, panel: Panel, x_range: Range1d | None, xlabel: str | None) -> figure:
    stacked = len(chart.panels) > 1 and not chart.beside
    height = round(_PANEL_PX * panel.height) if stacked else _LONE_PX
    options: dict[str, Any] = {"x_range": x_range} if x_range is not None else {}
    if panel.limits is not None:
        options["y_range"] = Range1d(start=panel.limits[0], end=panel.limits[1])
    plot = figure(
        height=height + (36 if xlabel else 0),
        sizing_mode="stretch_width",
        min_width=120,
        tools="xpan,xwheel_zoom,xbox_zoom,box_zoom,undo,reset,save",
        active_drag="xbox_zoom",
        active_scroll=None,
        toolbar_location="right",
        toolbar_inner=True,
        x_axis_type="log" if chart.logarithmic else "linear",
        y_axis_type="log" if panel.logarithmic else "linear",
        **options,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    _dress(plot)
    plot.yaxis.axis_label = panel.ylabel
    if xlabel:
        plot.xaxis.axis_label = xlabel
    else:
        plot.xaxis.visible = False
    return plot


def _dress(plot: figure) -> None:
    plot.min_border_left, plot.min_border_right = _LEFT_PX, _RIGHT_PX
    plot.background_fill_color = plot.border_fill_color = None  # the page's own ground
    plot.outline_line_color = None
    plot.grid.grid_line_color = LIGHT.shade
    for axis in plot.axis:
        axis.axis_label_text_color = axis.major_label_text_color = LIGHT.faint
        axis.axis_line_color = axis.major_tick_line_color = LIGHT.faint
        axis.minor_tick_line_color = None
        axis.axis_label_text_font_style = "normal"


def _draw(plot: figure, chart: Chart, panel: Panel, sources: Sources) -> None:
    if chart.shaded and not chart.beside:
        starts, ends = zip(*chart.shaded, strict=True)
        plot.vstrip(x0=starts, x1=ends, fill_color=LIGHT.shade, line_color=None)
    if panel.range_ is not None:
        low, high = panel.range_[1]
        plot.hstrip(y0=[low], y1=[high], fill_color=LIGHT.shade, line_color=None)
    if panel.zero:
        plot.add_layout(Span(location=0.0, dimension="width", line_color=LIGHT.faint))
    groups: dict[str, list[tuple[Curve, str, GlyphRenderer[Any]]]] = {}
    for curve in panel.curves:
        source, column = sources[id(curve)]
        shown = _curve(plot, panel, curve, source, column)
        groups.setdefault(source.id, []).append((curve, column, shown))
    for place, group in enumerate(groups.values()):
        plot.add_tools(_hover(group, panel.xlabel or chart.xlabel, first=place == 0))
    for _, at in panel.lines:
        look: dict[str, Any] = {"line_color": LIGHT.bad, "line_dash": "dotted", "line_width": 2}
        plot.add_layout(Span(location=at, dimension="height", **look))
    _spikes(plot, panel)


def _curve(
    plot: figure, panel: Panel, curve: Curve, source: ColumnDataSource, column: str
) -> GlyphRenderer[Any]:
    """Draw one curve, named by its label, so that its key can hide it."""
    look: dict[str, Any] = {
        "source": source,
        "color": curve.colour,
        "alpha": _FAINT if curve.faint else 1.0,
        "name": curve.label,
    }
    if curve.kind == "bars":
        bottom = panel.limits[0] if panel.logarithmic and panel.limits else 0.0
        return plot.vbar(x="x", top=column, width="width", bottom=bottom, **look)
    if curve.kind == "points":
        return plot.scatter(x="x", y=column, size=curve.width + 1.0, **look)
    if curve.kind == "ticks":
        return plot.scatter(x="x", y=column, marker="dash", angle=np.pi / 2, size=12, **look)
    if curve.band is not None:
        behind = look | {"alpha": 0.2, "y1": f"{column} low", "y2": f"{column} high"}
        plot.varea(x="x", **behind)
    return plot.line(x="x", y=column, line_width=curve.width, line_dash=curve.style, **look)


def _hover(
    group: Sequence[tuple[Curve, str, GlyphRenderer[Any]]], xlabel: str, *, first: bool
) -> HoverTool:
    """Return a tool that shows the values of one source's curves where the pointer is.

    The second one of a panel stands on the other side: one would cover the other.
    """
    curve, _, shown = group[0]
    columns = [(xlabel, "@x"), *((one.label, f"@{{{column}}}") for one, column, _ in group)]
    return HoverTool(
        renderers=[shown],
        tooltips=[(label, f"{column}{{%0.6g}}") for label, column in columns],
        formatters={column: "printf" for _, column in columns},
        mode="vline" if curve.kind == "line" else "mouse",
        attachment="right" if first else "left",
        point_policy="snap_to_data",
        line_policy="nearest",
        visible=False,
    )


def _spikes(plot: figure, panel: Panel) -> None:
    """Mark what lies beyond the scale at its edge, with its size under the pointer."""
    if panel.limits is None or not panel.spikes:
        return
    x, sizes = (np.array(row) for row in zip(*panel.spikes, strict=True))
    up = sizes > 0
    marks = plot.scatter(
        x="x",
        y="edge",
        marker="mark",
        size=9,
        color=LIGHT.bad,
        source=ColumnDataSource(
            {
                "x": x,
                "edge": np.where(up, panel.limits[1], panel.limits[0]),
                "size": sizes,
                "mark": np.where(up, "triangle", "inverted_triangle").tolist(),
            }
        ),
    )
    plot.add_tools(
        HoverTool(
            renderers=[marks],
            tooltips=[(panel.ylabel, "spike of @size{%0.4g}"), ("at", "@x{%0.6g}")],
            formatters={"@size": "printf", "@x": "printf"},
            visible=False,
        )
    )


def _sources(chart: Chart) -> Sources:
    """Return source and column of each curve; curves over one array of x share a source."""
    groups: dict[int, list[Curve]] = {}
    for panel in chart.panels:
        for curve in panel.curves:
            groups.setdefault(id(curve.x), []).append(curve)
    found = {}
    for curves in groups.values():
        kept = kept_rows([curve.y for curve in curves], _MOST_ROWS)
        data: dict[str, Any] = {"x": _sent(curves[0].x[kept])}
        source = ColumnDataSource()
        for place, curve in enumerate(curves):
            column = f"y{place}"
            data[column] = _sent(curve.y[kept])
            if curve.band is not None:
                data[f"{column} low"] = _sent((curve.y - curve.band)[kept])
                data[f"{column} high"] = _sent((curve.y + curve.band)[kept])
            if curve.bar_width is not None:
                data["width"] = _sent(curve.bar_width[kept])
            found[id(curve)] = source, column
        source.data = data
        source.tags = [[curve.label for curve in curves]]
    return found


def _sent(values: Array) -> NDArray[np.float32]:
    """Return values as the page holds them: seven digits, half the size."""
    return values.astype(np.float32)


def _strip(chart: Chart, x_range: Range1d) -> figure:
    """Return the whole run as a strip, with the window that is shown above it to be moved."""
    curve = next(one for one in chart.panels[0].curves if not one.faint)
    kept = kept_rows([curve.y], _STRIP_ROWS)
    low, high = chart.limits or (0.0, 1.0)
    plot = figure(
        name=f"{chart.name}-strip",
        height=_STRIP_PX,
        sizing_mode="stretch_width",
        min_width=120,
        tools="",
        toolbar_location=None,
        x_range=Range1d(start=low, end=high),
    )
    _dress(plot)
    plot.yaxis.major_label_text_font_size = "0px"
    plot.yaxis.major_tick_line_color = None
    plot.ygrid.grid_line_color = None
    plot.line(x=_sent(curve.x[kept]), y=_sent(curve.y[kept]), color=curve.colour, line_width=0.7)
    tool = RangeTool(x_range=x_range)
    tool.overlay.fill_color, tool.overlay.fill_alpha = LIGHT.predicted, 0.2
    plot.add_tools(tool)
    return plot
