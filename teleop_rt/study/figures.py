"""Figures of the studies, as PNG, SVG and PDF, in colours that colour-blind people distinguish."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

WIDEST_IN = 11.0  # as wide as a page shows at full size: all figures have one scale


def blank(columns: int, rows: int, width: float = 3.0, height: float = 2.2) -> Figure:
    """Return an empty figure for a grid of panels, each of this size [in], narrower where many."""
    wide = min(max(width * columns, 5.0), WIDEST_IN)
    return Figure(figsize=(wide, height * rows + 0.6), layout="constrained")


def legend(figure: Figure, axes: Axes) -> None:
    """Put the legend of one panel, which is valid for all, above the figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside upper center",
        ncols=len(labels) if len(labels) <= 6 else 4,
        frameon=False,
        fontsize="small",
    )


def save(figure: Figure, folder: Path, name: str) -> str:
    """Write NAME.png, NAME.svg and NAME.pdf, the same bytes each time; return the name."""
    figure.draw_without_rendering()  # places the panels once: each `savefig` would do it again
    figure.set_layout_engine(None)
    figure.savefig(folder / f"{name}.png", dpi=120, metadata={"Software": None})
    with mpl.rc_context({"svg.hashsalt": "teleop-rt", "svg.fonttype": "none"}):
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    figure.savefig(folder / f"{name}.pdf", metadata={"CreationDate": None})
    return name
