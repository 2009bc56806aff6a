"""Charts as files: SVG and PDF of the whole, and every value as CSV."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.charts import Chart, Curve
from teleop_rt.view.plots import figure_of, svg

Array = NDArray[np.float64]


def write_figures(charts: Iterable[Chart], folder: Path) -> list[Path]:
    """Write NAME.svg, NAME.pdf and NAME.csv of each chart into a folder; return their paths.

    A panel with an x of its own has a table of its own, NAME-2.csv.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for chart in charts:
        figure = figure_of(chart, whole=True)
        drawing, paper = folder / f"{chart.name}.svg", folder / f"{chart.name}.pdf"
        head = '<?xml version="1.0" encoding="utf-8"?>\n'
        drawing.write_text(head + svg(figure, chart.label), encoding="utf-8")
        with mpl.rc_context({"pdf.fonttype": 42}):  # text stays text
            figure.savefig(paper, metadata={"CreationDate": None})
        written += [drawing, paper]
        for place, (xlabel, curves) in enumerate(_tables(chart)):
            path = folder / f"{chart.name}{'' if place == 0 else f'-{place + 1}'}.csv"
            _write_table(path, xlabel, curves)
            written.append(path)
    return written


def _tables(chart: Chart) -> list[tuple[str, list[tuple[str, Curve]]]]:
    """Return the x label and the named curves of each table of a chart."""
    tables: dict[str, list[tuple[str, Curve]]] = {}
    for panel in chart.panels:
        named = tables.setdefault(panel.xlabel or chart.xlabel, [])
        named += [(f"{panel.ylabel} {curve.label}", curve) for curve in panel.curves]
    return list(tables.items())


def _write_table(path: Path, xlabel: str, curves: Sequence[tuple[str, Curve]]) -> None:
    """Write curves side by side, ordered by x: blank where a curve has no finite value."""
    x = np.unique(np.concatenate([curve.x for _, curve in curves]))
    columns = []
    for _, curve in curves:
        column = np.full(x.size, np.nan)
        column[np.searchsorted(x, curve.x)] = curve.y
        columns.append(column)
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow([xlabel, *(name for name, _ in curves)])
        for row in np.column_stack([x, *columns]):
            writer.writerow([f"{value:.9g}" if np.isfinite(value) else "" for value in row])
