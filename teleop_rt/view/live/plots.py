"""The plots of the live page: sources that scroll, one colour and line style per quantity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource, DataRange1d, Range1d
from bokeh.models.annotations.geometry import Band, Span
from bokeh.models.annotations.labels import Title
from bokeh.plotting import figure
from numpy.typing import NDArray

from teleop_rt.view.live.source import About
from teleop_rt.view.style import Palette

Array = NDArray[np.float64]
MOST_PARAMETERS = 3
_MARGIN = 0.15
_WIDEST = 0.1
"""Edges of a band wider than this share of its value do not stretch the axis: how the value moves
would be hidden. The band itself is always drawn whole."""


@dataclass(frozen=True, slots=True)
class Curve:
    """One line of a plot: the column that it shows, and how."""

    column: str
    label: str
    colour: str
    dash: str = "solid"
    width: float = 2.0


class Plot:
    """One scrolling plot over time."""

    def __init__(
        self,
        name: str,
        unit: str,
        palette: Palette,
        window_s: float,
        sources: Mapping[str, ColumnDataSource],
        curves: Sequence[tuple[str, Curve]],
        height: int = 230,
    ) -> None:
        """`curves` are (source, curve); the plot's model carries `name` for the page."""
        self.figure = figure(
            name=name,
            height=height,
            sizing_mode="stretch_width",
            tools="",
            toolbar_location=None,
            output_backend="canvas",
            x_range=DataRange1d(follow="end", follow_interval=window_s, range_padding=0.0),
            y_range=DataRange1d(range_padding=_MARGIN, only_visible=True),
        )
        for source, curve in curves:
            self.figure.line(
                "t",
                curve.column,
                source=sources[source],
                color=curve.colour,
                line_dash=curve.dash,
                line_width=curve.width,
                legend_label=curve.label,
            )
        self.figure.xaxis.axis_label = "time [s]"
        self.figure.yaxis.axis_label = unit
        dress(self.figure, palette)


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
    if plot.legend:
        plot.add_layout(plot.legend[0], "above")
        plot.legend.orientation = "horizontal"
        plot.legend.margin = 0
        plot.legend.background_fill_color = None
        plot.legend.border_line_color = None
        plot.legend.label_text_color = palette.text


class Parameters:
    """The parameters of the selected estimator over time, each with two deviations either way."""

    def __init__(self, palette: Palette, window_s: float) -> None:
        columns: dict[str, list[float]] = {"t": []}
        for place in range(MOST_PARAMETERS):
            for name in ("p", "low", "high", "low_edge", "high_edge"):
                columns[f"{name}{place}"] = []
        self.source = ColumnDataSource(columns, name="parameters")
        self._titles: list[Title] = []
        self.figures = [self._panel(place, palette, window_s) for place in range(MOST_PARAMETERS)]
        self.row = -1
        self._names: list[str] = []

    def _panel(self, place: int, palette: Palette, window_s: float) -> figure:
        plot = Plot(
            f"parameter{place}",
            "",
            palette,
            window_s,
            {"p": self.source},
            [("p", Curve(f"p{place}", "estimate", palette.predicted))],
            height=170,
        ).figure
        plot.legend.visible = False
        for edge in ("low", "high"):
            plot.line(
                "t", f"{edge}_edge{place}", source=self.source, color=palette.predicted, alpha=0.5
            )
        plot.title = Title(text=" ", text_color=palette.text)
        self._titles.append(plot.title)
        band = Band(
            base="t",
            lower=f"low{place}",
            upper=f"high{place}",
            source=self.source,
            fill_color=palette.predicted,
            fill_alpha=0.25,
            line_width=0,
        )
        plot.add_layout(band)
        return plot

    def select(self, about: About, row: int, columns: Mapping[str, Array]) -> None:
        """Show another estimator; its rows so far are taken in by the next `stream`."""
        model, regression, solver = about.rows[row]
        self.row = row
        self._names = [name for name in columns if f"{name}_std" in columns and name != "offset"][
            :MOST_PARAMETERS
        ]
        self.source.data = {name: [] for name in self.source.column_names}
        for place, (plot, title) in enumerate(zip(self.figures, self._titles, strict=True)):
            plot.visible = place < len(self._names)
            if plot.visible:
                title.text = f"{self._names[place]}: {model}, {regression}, {solver}"

    def stream(self, columns: Mapping[str, Array], t: Array, rollover: int) -> None:
        """Append rows of the selected estimator; what is no estimate yet is left out."""
        unknown = np.isin(columns["status"], (0.0, 3.0))
        new: dict[str, Any] = {"t": t}
        for place in range(MOST_PARAMETERS):
            known = place < len(self._names)
            values = columns[self._names[place]] if known else np.full(t.size, np.nan)
            spread = columns[f"{self._names[place]}_std"] if known else np.full(t.size, np.nan)
            values = np.where(unknown, np.nan, values)
            edge = np.where(spread > _WIDEST * np.abs(values), np.nan, spread)
            new[f"p{place}"] = values
            new[f"low{place}"] = values - 2.0 * spread
            new[f"high{place}"] = values + 2.0 * spread
            new[f"low_edge{place}"] = values - 2.0 * edge
            new[f"high_edge{place}"] = values + 2.0 * edge
        self.source.stream(new, rollover)


def correlation_plot(palette: Palette) -> tuple[figure, ColumnDataSource, list[Span]]:
    """Return the plot of the residual's autocorrelation, its source, and the bounds of chance."""
    source = ColumnDataSource({"lag": [], "value": []}, name="correlation")
    plot = figure(
        name="correlation",
        height=230,
        sizing_mode="stretch_width",
        tools="",
        toolbar_location=None,
        y_range=Range1d(start=-1.0, end=1.0),
    )
    plot.vbar(x="lag", top="value", width=8.0, source=source, color=palette.residual)
    bounds = [
        Span(dimension="width", line_color=palette.faint, line_dash="dashed", location=0.0)
        for _ in range(2)
    ]
    for bound in bounds:
        plot.add_layout(bound)
    plot.xaxis.axis_label = "lag [ms]"
    plot.yaxis.axis_label = "autocorrelation"
    dress(plot, palette)
    return plot, source, bounds
