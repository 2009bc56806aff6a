"""Charts on paper: matplotlib figures, as SVG that is the same each time."""

from __future__ import annotations

import io
import re

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

from teleop_rt.view.charts import Chart, Curve, Limits, Panel, kept_rows
from teleop_rt.view.style import FAINT, LIGHT

_MOST_ROWS = 1200  # points per curve: a printed page is no wider in dots that are seen
# Inches on paper: width and height of a panel, margins, and rows of the key.
_WIDTH_IN, _PANEL_IN = 10.0, 1.5
_LEFT_IN, _RIGHT_IN, _BELOW_IN, _BETWEEN_IN = 0.85, 0.15, 0.45, 0.15
_ABOVE_IN, _KEYS_IN_A_ROW, _ROW_IN = 0.12, 3, 0.18
_DASHES = {"solid": "-", "dashed": "--", "dotted": ":", "dotdash": "-."}


def figure_of(chart: Chart, *, whole: bool = False) -> Figure:
    """Return a chart as a figure as wide as a page; `whole` shows all of it, not its window."""
    ratios = [panel.height for panel in chart.panels]
    rows = 1 if chart.beside else len(ratios)
    above = _ABOVE_IN + _ROW_IN * -(-len(list(chart.curves)) // _KEYS_IN_A_ROW)
    limits = chart.limits if whole else chart.window or chart.limits
    stack = 1.7 * _PANEL_IN if rows == 1 else _PANEL_IN * (max(ratios) + rows - 1)
    height = stack + above + _BELOW_IN
    with mpl.rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(_WIDTH_IN, height))
        figure.subplots_adjust(
            left=_LEFT_IN / _WIDTH_IN,
            right=1.0 - _RIGHT_IN / _WIDTH_IN,
            bottom=_BELOW_IN / height,
            top=1.0 - above / height,
            hspace=_BETWEEN_IN * rows / stack,
            wspace=0.25,
        )
        shared = {"width_ratios": chart.beside} if chart.beside else {"height_ratios": ratios}
        columns = len(ratios) if chart.beside else 1
        grid = figure.subplots(rows, columns, squeeze=False, sharex=not chart.beside, **shared)
        panels = list(grid.flat)
        for axes, panel in zip(panels, chart.panels, strict=True):
            _draw(axes, chart, panel, limits)
        figure.align_ylabels(panels)
    if panels[-1].get_xlabel() == "":
        panels[-1].set_xlabel(chart.xlabel)
    if chart.beside:
        panels[0].set_xlabel(chart.xlabel)
    if limits is not None:
        panels[0].set_xlim(limits)
    _legend(panels[0], chart)
    return figure


def _draw(axes: Axes, chart: Chart, panel: Panel, limits: Limits | None) -> None:
    axes.broken_barh(
        [(start, end - start) for start, end in chart.shaded],
        (0.0, 1.0),
        transform=axes.get_xaxis_transform(),
        facecolor=LIGHT.shade,
        zorder=0,
    )
    if panel.range_ is not None:
        label, limits = panel.range_
        axes.axhspan(*limits, color=LIGHT.shade, label=label, zorder=0)
    if chart.logarithmic:
        axes.set_xscale("log")
    if panel.logarithmic:
        axes.set_yscale("log")
    for curve in panel.curves:
        _curve(axes, curve, None if panel.xlabel else limits)
    if panel.zero:
        axes.axhline(0.0, color=LIGHT.text, linewidth=0.5)
    for label, at in panel.lines:
        axes.axvline(at, color=LIGHT.bad, linewidth=1.6, linestyle=":", label=label)
    axes.set_ylabel(panel.ylabel)
    if panel.xlabel is not None:
        axes.set_xlabel(panel.xlabel)
    if panel.limits is not None:
        axes.set_ylim(panel.limits)
        for at, size in panel.spikes:
            edge, mark = (panel.limits[1], "^") if size > 0 else (panel.limits[0], "v")
            axes.plot(at, edge, mark, color=LIGHT.bad, markersize=6, clip_on=True)


def _curve(axes: Axes, curve: Curve, limits: Limits | None) -> None:
    """Draw one curve between the limits of x."""
    low, high = limits or (-np.inf, np.inf)
    shown = np.flatnonzero((curve.x >= low) & (curve.x <= high))
    look = {"color": curve.colour, "alpha": FAINT if curve.faint else 1.0}
    if curve.kind == "bars":
        axes.bar(curve.x, curve.y, width=curve.bar_width, label=curve.label, **look)  # type: ignore[arg-type]
        return
    if curve.kind in {"points", "ticks"}:
        mark = "." if curve.kind == "points" else "|"
        some = slice(None, None, 1 + curve.x.size // _MOST_ROWS)
        axes.plot(curve.x[some], curve.y[some], mark, ms=curve.width, label=curve.label, **look)  # type: ignore[arg-type]
        return
    kept = shown[kept_rows([curve.y[shown]], _MOST_ROWS)]
    x, y = curve.x[kept], curve.y[kept]
    if curve.band is not None:
        band = curve.band[kept]
        axes.fill_between(x, y - band, y + band, color=curve.colour, alpha=0.2, linewidth=0.0)
    axes.plot(
        x,
        y,
        linewidth=0.8 * curve.width,
        linestyle=_DASHES[curve.style],
        label=curve.label,
        **look,  # type: ignore[arg-type]
    )


def _legend(axes: Axes, chart: Chart) -> None:
    """Put the legend above the panels, where it hides nothing."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=_KEYS_IN_A_ROW if len(list(chart.curves)) > _KEYS_IN_A_ROW else 5,
        frameon=False,
        borderpad=0.2,
        columnspacing=1.2,
        handlelength=1.6,
    )


def svg(figure: Figure, label: str) -> str:
    """Return a figure as SVG, the same text each time; `label` is for screen readers."""
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": label, "svg.fonttype": "none"}):
        # `savefig` would draw it twice.
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})  # type: ignore[no-untyped-call]
    content = text.getvalue()
    # Groups are named alike in every figure, and nothing refers to them.
    content = re.sub(r'<g id="[^"]*"', "<g", content[content.index("<svg") :])
    return content.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)
