"""Templates of the pages: plain HTML that needs nothing from elsewhere."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from jinja2 import ChainableUndefined, Environment, PackageLoader

from teleop_rt.view import style
from teleop_rt.view.charts import Chart
from teleop_rt.view.gaps import broken_at_gaps
from teleop_rt.view.plots import figure_of, svg
from teleop_rt.view.screen import linked_figures, script


@dataclass(frozen=True, slots=True)
class Tile:
    """One answer: a grade (good, attention, bad or unknown), a value, and its explanation."""

    title: str
    grade: str
    value: str
    lines: tuple[str, ...]


def figures_of(charts: Sequence[Chart]) -> dict[str, Any]:
    """Return the charts of a page: `charts` by name, `paper`, `screen` and `script`."""
    charts = [broken_at_gaps(chart) for chart in charts]
    return {
        "charts": {chart.name: chart for chart in charts},
        "paper": {chart.name: svg(figure_of(chart), chart.label) for chart in charts},
        "screen": linked_figures(charts),
        "script": script(),
    }


def render(template: str, **content: object) -> str:
    """Return a page of `teleop_rt/view/pages` as HTML; the style goes with every page."""
    pages = Environment(
        loader=PackageLoader("teleop_rt.view", "pages"),
        autoescape=True,
        undefined=ChainableUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return pages.get_template(template).render(style=style, **content)
