"""Figures of the studies, as PNG and SVG: colours that colour-blind people can tell apart."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

# Okabe and Ito 2008, and a line style each: a figure must be told apart in grey, too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), "-")
MARKERS = "osD^vPX"
TRUTH_STYLE = {"color": "black", "linewidth": 0.8, "linestyle": ":"}
UNITS = {
    "kelvin-voigt": {"k": "k [N/m]", "b": "b [N s/m]"},
    "hunt-crossley": {"k": "k [N/mⁿ]", "b": "b [N s/mⁿ⁺¹]", "n": "n [-]"},
}
ABBREVIATED = {"kelvin-voigt": "Kelvin-Voigt", "hunt-crossley": "Hunt-Crossley"}


def method_name(regression: str, solver: str) -> str:
    """Return what a figure calls a method."""
    names = {"rls": "RLS", "sprls": "SPRLS", "ni-sprls": "NI-SPRLS", "gn-vff-rls": "GN-VFF-RLS"}
    name = names.get(solver, "integral error")
    return f"algebraic + {name}" if regression == "algebraic" else name


def blank(columns: int, rows: int, width: float = 3.0, height: float = 2.2) -> Figure:
    """Return an empty figure for a grid of panels, each of this size [in]."""
    return Figure(figsize=(max(width * columns, 5.0), height * rows + 0.6), layout="constrained")


def legend(figure: Figure, axes: Axes) -> None:
    """Put the legend of one panel, which stands for all, above the figure."""
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
    """Write NAME.png and NAME.svg, the same bytes each time; return the name."""
    figure.savefig(folder / f"{name}.png", dpi=120, metadata={"Software": None})
    with mpl.rc_context({"svg.hashsalt": "teleop-rt", "svg.fonttype": "none"}):
        figure.savefig(folder / f"{name}.svg", metadata={"Date": None})
    return name
