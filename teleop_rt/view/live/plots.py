"""The plots of the live page: their curves, one colour and line style per quantity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from bokeh.models import ColumnDataSource, HoverTool, Range1d
from bokeh.models.annotations.geometry import Band
from bokeh.models.annotations.labels import Title
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure

from teleop_rt.view.style import (
    ASKED,
    MEASURED,
    PREDICTED,
    RAW,
    RENDERED,
    RESIDUAL,
    SURFACE,
    Palette,
)

MOST_PARAMETERS = 3
"""Parameters with a plot of their own: k, b and n."""
_PARAMETER = ("p", "low", "high", "low_edge", "high_edge")
SOURCES: Mapping[str, tuple[str, ...]] = {
    "slave": (
        "t",
        "force",
        "filtered_force",
        "predicted_force",
        "position",
        "target",
        "surface",
    ),
    "master": ("t", "rendered_force"),
    "residual": ("t", "residual"),
    "parameters": (
        "t",
        *(f"{name}{place}" for place in range(MOST_PARAMETERS) for name in _PARAMETER),
    ),
    "correlation": ("lag", "width", "value", "bound", "other_bound"),
}
"""The columns of each source of the page."""


_HAIRLINE = 1.0
"""A browser without a graphics processor paints a line of one pixel ten times faster than a wider
one of as many points."""


@dataclass(frozen=True, slots=True)
class LiveCurve:
    """One line of a plot: the source and the column that it shows, and how; hidden until chosen."""

    source: str
    column: str
    label: str
    colour: str
    dash: str = "solid"
    hidden: bool = False


@dataclass(frozen=True, slots=True)
class Plot:
    """A plot, its legend, and the columns `(source, column)` that its axes must hold.

    Of `value` they hold only the newest, or all where the others are unknown: how an estimate began
    would hide how it moves now. The page shows the legend: bokeh's own is laid out again whenever
    its plot is painted.
    """

    figure: figure
    held: tuple[tuple[str, str], ...]
    legend: tuple[LiveCurve, ...] = ()
    value: tuple[str, str] | None = None


def make_sources() -> dict[str, ColumnDataSource]:
    """Return the sources of a page, each with a row of nothing: a legend shows no empty line."""
    return {
        name: ColumnDataSource({column: [math.nan] for column in columns}, name=name)
        for name, columns in SOURCES.items()
    }


def make_plots(p: Palette, sources: Mapping[str, ColumnDataSource]) -> list[Plot]:
    """Return every plot of the page on the ground of `p`."""
    force = [
        LiveCurve("slave", "filtered_force", f"{MEASURED}, filtered", p.measured),
        LiveCurve("slave", "predicted_force", PREDICTED, p.predicted, "dashed"),
        LiveCurve("master", "rendered_force", RENDERED, p.rendered),
        LiveCurve("slave", "force", RAW, p.target, "dotted", hidden=True),
    ]
    position = [
        LiveCurve("slave", "target", ASKED, p.target),
        LiveCurve("slave", "position", MEASURED, p.measured),
        LiveCurve("slave", "surface", SURFACE, p.predicted, "dashed"),
    ]
    residual = [LiveCurve("residual", "residual", RESIDUAL, p.residual)]
    return [
        scrolling("force", p, sources, force, height=195),
        scrolling("position", p, sources, position),
        scrolling("residual", p, sources, residual),
        *(_parameter(place, p, sources) for place in range(MOST_PARAMETERS)),
        _correlation(p, sources["correlation"]),
    ]


def scrolling(
    name: str,
    palette: Palette,
    sources: Mapping[str, ColumnDataSource],
    curves: Sequence[LiveCurve],
    height: int = 175,
) -> Plot:
    """Return a plot over time; the page moves its axes, so that no browser must search for them."""
    plot = _blank(name, height)
    drawn: dict[str, list[tuple[LiveCurve, GlyphRenderer[Any]]]] = {}
    for curve in curves:
        line = plot.line(
            "t",
            curve.column,
            source=sources[curve.source],
            color=curve.colour,
            line_dash=curve.dash,
            line_width=_HAIRLINE,
            name=f"{plot.name}.{curve.column}",
            visible=not curve.hidden,
        )
        drawn.setdefault(curve.source, []).append((curve, line))
    for place, group in enumerate(drawn.values()):
        plot.add_tools(_hover(group, first=place == 0))
    plot.xaxis.axis_label = "time [s]"
    plot.yaxis.axis_label = name
    dress(plot, palette)
    held = tuple((curve.source, curve.column) for curve in curves)
    return Plot(plot, held, tuple(curves) if len(curves) > 1 else ())


def _hover(group: Sequence[tuple[LiveCurve, GlyphRenderer[Any]]], *, first: bool) -> HoverTool:
    """Return a tool that shows the values of one source's curves at the time that is pointed at.

    The second one of a plot stands on the other side: one would cover the other.
    """
    values = [(curve.label, f"@{curve.column}{{0.0000}}") for curve, _ in group]
    return HoverTool(
        renderers=[group[0][1]],
        tooltips=[("time", "@t{0.000} s"), *values],
        mode="vline",
        attachment="right" if first else "left",
        visible=False,
    )


def _blank(name: str, height: int) -> figure:
    return figure(
        name=f"plot_{name}",
        height=height,
        sizing_mode="stretch_width",
        tools="",
        toolbar_location=None,
        output_backend="canvas",
        x_range=Range1d(start=0.0, end=1.0),
        y_range=Range1d(start=-1.0, end=1.0),
    )


def dress(plot: figure, palette: Palette) -> None:
    """Give a plot the colours of its ground."""
    plot.background_fill_color = palette.panel
    plot.border_fill_color = palette.ground
    plot.outline_line_color = None
    plot.grid.grid_line_color = palette.shade
    for axis in plot.axis:
        axis.axis_label_text_color = axis.major_label_text_color = palette.faint
        axis.axis_line_color = axis.major_tick_line_color = palette.faint
        axis.minor_tick_line_color = None
        axis.axis_label_text_font_style = "normal"


def _parameter(place: int, palette: Palette, sources: Mapping[str, ColumnDataSource]) -> Plot:
    """Return the plot of one parameter of the selected model, two deviations either way."""
    source = sources["parameters"]
    curve = LiveCurve("parameters", f"p{place}", "estimate", palette.predicted)
    plot = scrolling(f"parameter{place}", palette, sources, [curve]).figure
    plot.yaxis.axis_label = ""
    edges = [f"{edge}_edge{place}" for edge in ("low", "high")]
    for edge in edges:
        plot.line("t", edge, source=source, color=palette.predicted, alpha=0.5)
    plot.title = Title(text=" ", text_color=palette.text)
    band = Band(
        base="t",
        lower=f"low{place}",
        upper=f"high{place}",
        source=source,
        fill_color=palette.predicted,
        fill_alpha=0.25,
        line_width=0,
    )
    plot.add_layout(band)
    held = tuple(("parameters", name) for name in edges)
    return Plot(plot, held, value=("parameters", f"p{place}"))


def _correlation(palette: Palette, source: ColumnDataSource) -> Plot:
    """Return the plot of the residual's autocorrelation, between the bounds of chance."""
    plot = _blank("correlation", 175)
    plot.vbar(x="lag", top="value", width="width", source=source, color=palette.residual)
    for bound in ("bound", "other_bound"):
        plot.line("lag", bound, source=source, color=palette.faint, line_dash="dashed")
    plot.xaxis.axis_label = "lag [ms], dashed: 95 % of white noise"
    plot.yaxis.axis_label = "autocorrelation"
    dress(plot, palette)
    held = tuple(("correlation", name) for name in ("value", "bound", "other_bound"))
    return Plot(plot, held)
