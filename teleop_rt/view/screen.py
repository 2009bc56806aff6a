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
    CrosshairTool,
    Range1d,
    RangeTool,
)
from bokeh.models.annotations.geometry import Span
from bokeh.plotting import figure
from bokeh.resources import Resources
from numpy.typing import NDArray

from teleop_rt.view.charts import Chart, Panel, kept_rows
from teleop_rt.view.glyphs import as_page_values, curve_sources, draw
from teleop_rt.view.style import IN_THE_DARK, LIGHT

Array = NDArray[np.float64]

_STRIP_ROWS = 1_000  # of the strip, which is as wide as the page
_PANEL_PX, _STRIP_PX, _LONE_PX = 120, 56, 240  # heights: one of several, the strip, one alone
_LEFT_PX, _RIGHT_PX = 76, 8  # one margin for all: time axes of a page lie below each other


@dataclass(frozen=True, slots=True)
class Screen:
    """The parts of a page: the program, the figures as JSON, and the places of each chart."""

    program: str
    figures: str
    places: Mapping[str, Sequence[str]]


def linked_figures(charts: Iterable[Chart]) -> Screen:
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
    """Return the script that shows the figures and answers the buttons of a page."""
    return (files("teleop_rt.view") / "pages" / "screen.js").read_text(encoding="utf-8")


def _figures(chart: Chart, shared: dict[str, Range1d]) -> Iterator[figure]:
    x_range = _x_range(chart, shared)
    hair = Span(dimension="height", line_color=LIGHT.faint, line_width=0.7)
    sources = curve_sources(chart)
    last = len(chart.panels) - 1
    for place, panel in enumerate(chart.panels):
        own = chart.beside and place > 0
        label = panel.xlabel or (chart.xlabel if place == last or chart.beside else None)
        plot = _blank(chart, panel, None if own else x_range, label)
        plot.name = f"{chart.name}-{place}"
        draw(plot, chart, panel, sources)
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
    plot.line(
        x=as_page_values(curve.x[kept]),
        y=as_page_values(curve.y[kept]),
        color=curve.colour,
        line_width=0.7,
    )
    tool = RangeTool(x_range=x_range)
    tool.overlay.fill_color, tool.overlay.fill_alpha = LIGHT.predicted, 0.2
    plot.add_tools(tool)
    return plot
