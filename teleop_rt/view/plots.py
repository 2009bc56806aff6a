"""What all figures of a page share: SVG text, contacts shaded, peaks that survive thinning."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from numpy.typing import NDArray

from teleop_rt.view.style import LIGHT

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

_BUCKETS = 1200
_WHOLE_IN, _HALF_IN = 10.0, 6.0
_LEFT_IN, _RIGHT_IN, _ABOVE_IN, _BELOW_IN, _BETWEEN_IN = 0.85, 0.15, 0.3, 0.45, 0.15
_width_in: ContextVar[float] = ContextVar("width_in", default=_WHOLE_IN)


@contextmanager
def side_by_side() -> Iterator[None]:
    """Draw figures for half a page, so that their text can still be read there."""
    token = _width_in.set(_HALF_IN)
    try:
        yield
    finally:
        _width_in.reset(token)


def blank(
    height: float, rows: int = 1, columns: int = 1, **options: object
) -> tuple[Figure, list[Axes]]:
    """Return a figure as wide as a page, `height` inches high, and its panels, row by row.

    Its margins are fixed: the time axes of a page lie below each other, and nothing is laid out.
    """
    width = _width_in.get()
    panel = (height - _ABOVE_IN - _BELOW_IN - (rows - 1) * _BETWEEN_IN) / rows
    with mpl.rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(width, height))
        figure.subplots_adjust(
            left=_LEFT_IN / width,
            right=1.0 - _RIGHT_IN / width,
            bottom=_BELOW_IN / height,
            top=1.0 - _ABOVE_IN / height,
            hspace=_BETWEEN_IN / panel,
            wspace=0.1,
        )
        panels = figure.subplots(rows, columns, squeeze=False, **options)  # type: ignore[call-overload]
        figure.align_ylabels(panels)
    return figure, list(panels.flat)


def svg(figure: Figure, label: str) -> str:
    """Return a figure as SVG, the same text each time; `label` is what a screen reader says."""
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": label, "svg.fonttype": "none"}):
        # `savefig` would draw it twice.
        FigureCanvasSVG(figure).print_svg(text, metadata={"Date": None})  # type: ignore[no-untyped-call]
    content = text.getvalue()
    # Groups are named alike in every figure, and nothing refers to them.
    content = re.sub(r'<g id="[^"]*"', "<g", content[content.index("<svg") :])
    return content.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)


def legend(axes: Axes) -> None:
    """Put the legend above the panel, where it hides nothing."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0.0, 1.0),
        ncols=5,
        frameon=False,
        borderpad=0.2,
        columnspacing=1.2,
        handlelength=1.6,
    )


def seconds(columns: Columns, start_ns: float) -> Array:
    """Return the time of each row in s since `start_ns`."""
    return (columns["stamp_ns"] - start_ns) * 1e-9


def line(axes: Axes, t: Array, values: Array, **style: object) -> None:
    """Plot values over time; of many samples the least and the largest of each bucket are drawn."""
    axes.plot(*thinned(t, values), **style)  # type: ignore[arg-type]


def thinned(t: Array, values: Array) -> tuple[Array, Array]:
    """Return at most 2 x 1200 points: the first least and the first largest of each bucket.

    A bucket without any finite value gives not-a-number, so gaps stay gaps.
    """
    size = values.size // _BUCKETS
    if size <= 2:
        return t, values
    whole = values[: size * _BUCKETS].reshape(_BUCKETS, size)
    known = np.isfinite(whole)
    low = np.argmin(np.where(known, whole, np.inf), axis=1)
    high = np.argmax(np.where(known, whole, -np.inf), axis=1)
    places = np.sort(np.stack([low, high], axis=1), axis=1) + size * np.arange(_BUCKETS)[:, None]
    rest = np.arange(size * _BUCKETS, values.size)
    index = np.concatenate([places.ravel(), rest])
    return t[index], values[index]


def shade_contact(axes: Axes, t: Array, in_contact: Array) -> None:
    """Shade the time in contact."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0.0], in_contact, [0.0]))))
    starts, ends = t[edges[::2]], t[np.minimum(edges[1::2], t.size - 1)]
    axes.broken_barh(
        list(zip(starts, ends - starts, strict=True)),
        (0.0, 1.0),
        transform=axes.get_xaxis_transform(),
        facecolor=LIGHT.shade,
        zorder=0,
    )


def settled_limits(values: list[Array]) -> tuple[float, float] | None:
    """Return limits of an axis that show what settles, not how it began; None without values."""
    known = np.concatenate([v[np.isfinite(v)] for v in values]) if values else np.empty(0)
    if known.size == 0:
        return None
    low, middle, high = np.quantile(known, [0.05, 0.5, 0.95])
    margin = max(0.3 * (high - low), 0.01 * abs(middle), 1e-12)
    return float(low - margin), float(high + margin)
