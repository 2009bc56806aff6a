"""The curves of one panel as Bokeh draws them, with the values that the pointer shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, HoverTool
from bokeh.models.annotations.geometry import Span
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from numpy.typing import NDArray

from teleop_rt.view.charts import Chart, Curve, Panel, kept_rows
from teleop_rt.view.style import FAINT, LIGHT

Array = NDArray[np.float64]
Sources = dict[int, tuple[ColumnDataSource, str]]
"""Source and column of each curve, by the curve's identity."""

_MOST_ROWS = 24_000  # per source: every tick of 24 s at 1 kHz, of a longer run the extremes


def draw(plot: figure, chart: Chart, panel: Panel, sources: Sources) -> None:
    """Draw a panel into its figure: shades, curves with their hover tools, lines and spikes."""
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
        "alpha": FAINT if curve.faint else 1.0,
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
    """Mark values beyond the scale at its edge, with their size under the pointer."""
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


def curve_sources(chart: Chart) -> Sources:
    """Return source and column of each curve; curves over one array of x share a source."""
    groups: dict[int, list[Curve]] = {}
    for panel in chart.panels:
        for curve in panel.curves:
            groups.setdefault(id(curve.x), []).append(curve)
    found = {}
    for curves in groups.values():
        kept = kept_rows([curve.y for curve in curves], _MOST_ROWS)
        data: dict[str, Any] = {"x": as_page_values(curves[0].x[kept])}
        source = ColumnDataSource()
        for place, curve in enumerate(curves):
            column = f"y{place}"
            data[column] = as_page_values(curve.y[kept])
            if curve.band is not None:
                data[f"{column} low"] = as_page_values((curve.y - curve.band)[kept])
                data[f"{column} high"] = as_page_values((curve.y + curve.band)[kept])
            if curve.bar_width is not None:
                data["width"] = as_page_values(curve.bar_width[kept])
            found[id(curve)] = source, column
        source.data = data
        source.tags = [[curve.label for curve in curves]]
    return found


def as_page_values(values: Array) -> NDArray[np.float32]:
    """Return values as the page holds them: seven digits, half the size.

    A deviation that the data do not determine may be larger than such a number; it is infinite.
    """
    with np.errstate(over="ignore"):
        return values.astype(np.float32)
