"""A figure as data: panels, curves and marks, for the screen, for paper and as a table."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.style import Style

Array = NDArray[np.float64]
TIME = "time [s]"
NEAR, WHOLE = "near", "whole"
"""Names of the two linked time axes: of a few swings, and of the whole run."""
Limits = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One curve of n points; `band` is the half width of a band around it (n,).

    `kind` is how it is drawn: a line, points, ticks on the axis, bars of `bar_width`, or
    horizontal bars, whose length is `x` and whose place is `y`. Colours are those of the light
    ground.
    """

    label: str
    x: Array
    y: Array
    colour: str
    kind: Literal["line", "points", "ticks", "bars", "horizontal bars"] = "line"
    width: float = 1.0
    style: Style = "solid"
    faint: bool = False
    band: Array | None = None
    bar_width: Array | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One pair of axes. `spikes` are points beyond `limits`: they are marked at the edge.

    `range_` is a horizontal band `(low, high)` and `lines` are vertical lines `{label: x}`.
    """

    ylabel: str
    curves: tuple[Curve, ...]
    height: float = 1.0
    limits: Limits | None = None
    spikes: tuple[tuple[float, float], ...] = ()
    zero: bool = False
    range_: tuple[str, Limits] | None = None
    lines: tuple[tuple[str, float], ...] = ()
    logarithmic: bool = False
    equal: bool = False
    xlabel: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Chart:
    """One figure: panels over one x axis, stacked, or beside each other as wide as `beside` says.

    `shaded` are the spans of contact. `limits` are those of the x axis, None for all there is.
    `window` is the part of the whole that is shown at first, with the whole as a strip. Charts of
    one `linked` name share their x axis on the screen.
    """

    name: str
    label: str
    xlabel: str
    panels: tuple[Panel, ...]
    limits: Limits | None = None
    window: Limits | None = None
    shaded: tuple[Limits, ...] = ()
    linked: str = ""
    beside: tuple[int, ...] = ()
    logarithmic: bool = False
    notes: tuple[str, ...] = field(default=())

    @property
    def curves(self) -> Iterable[Curve]:
        """Every curve once, in order: those of one label in several panels are one key."""
        found = {curve.label: curve for panel in self.panels for curve in panel.curves}
        return found.values()


def kept_rows(columns: Sequence[Array], most: int) -> NDArray[np.intp]:
    """Return the rows of columns (n,) to draw, about `most` at most: the extremes of each bucket.

    Of every column and bucket the first least and the first largest row are kept, so all columns
    stay columns of one table; and the first row of each gap, so gaps stay gaps.
    """
    count = columns[0].size
    if count <= most:
        return np.arange(count)
    buckets = max(1, most // (2 * len(columns)))
    size = -(-count // buckets)
    parts = []
    for column in columns:
        whole = np.full(buckets * size, np.nan)
        whole[:count] = column
        rows = whole.reshape(buckets, size)
        known = np.isfinite(rows)
        first = size * np.arange(buckets)
        parts += [
            np.argmin(np.where(known, rows, np.inf), axis=1) + first,
            np.argmax(np.where(known, rows, -np.inf), axis=1) + first,
            np.flatnonzero(np.diff(np.isnan(column).astype(np.int8)) > 0) + 1,
        ]
    kept = np.unique(np.concatenate(parts))
    return kept[kept < count]


def spans(x: Array, flags: Array) -> tuple[Limits, ...]:
    """Return `(begin, end)` of each span of `x` (n,) in which `flags` (n,) is not zero."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0.0], flags > 0, [0.0]))))
    ends = np.minimum(edges[1::2], x.size - 1)
    return tuple((float(x[a]), float(x[b])) for a, b in zip(edges[::2], ends, strict=True))


def settled_limits(values: Iterable[Array]) -> Limits | None:
    """Return limits of an axis that show the settled values, not the start; None without values."""
    parts = [v[np.isfinite(v)] for v in values]
    known = np.concatenate(parts) if parts else np.empty(0)
    if known.size == 0:
        return None
    low, middle, high = np.quantile(known, [0.05, 0.5, 0.95])
    margin = max(0.3 * (high - low), 0.01 * abs(middle), 1e-12)
    return float(low - margin), float(high + margin)


ROBUST_QUANTILE = 0.95  # share of the samples within the scale: rarer values are spikes
ROBUST_ROOM = 1.5  # times that quantile: the residual fills two thirds of its axis
SPIKE_GAP = 0.01  # share of the run; excursions closer together are one spike


def robust_limits(x: Array, y: Array) -> tuple[Limits | None, tuple[tuple[float, float], ...]]:
    """Return symmetric limits that no spike sets, and the largest point of each spike beyond.

    `x` and `y` are of shape (n,). None without finite values, or where all of them are zero.
    """
    known = np.isfinite(y)
    if not known.any():
        return None, ()
    most = ROBUST_ROOM * float(np.quantile(np.abs(y[known]), ROBUST_QUANTILE))
    largest = float(np.max(np.abs(y[known])))
    if largest <= 0.0:
        return None, ()
    if most <= 0.0 or largest <= most:
        return (-1.1 * largest, 1.1 * largest), ()
    beyond = np.flatnonzero(known & (np.abs(y) > most))
    gaps = np.flatnonzero(np.diff(x[beyond]) > SPIKE_GAP * float(x[-1] - x[0]))
    peaks = [group[np.argmax(np.abs(y[group]))] for group in np.split(beyond, gaps + 1)]
    return (-most, most), tuple((float(x[i]), float(y[i])) for i in peaks)


SWINGS = 4  # periods of the motion in a window: few enough to distinguish curves
SHORTEST_WINDOW_S = 0.25  # no window is shorter, however fast the motion shakes
FEWEST_TURNS = 3  # through the middle of the motion; with fewer there is no period to speak of


def few_swings(t: Array, position: Array, in_contact: Array) -> Limits | None:
    """Return a window of a few swings at the end of the last contact that can hold it.

    All of shape (n,). The period is the median time between two rises through the contact's middle
    position. None without contact; where the motion does not swing, or the window would hold the
    run, the whole of that contact or run.
    """
    touching = np.flatnonzero((in_contact > 0) & np.isfinite(position))
    if touching.size < 2:
        return None
    period_s = _period_s(t[touching], position[touching])
    contacts = spans(t, in_contact)
    if period_s is None:
        start, end = max(contacts, key=lambda one: one[1] - one[0])
        return start, end
    length_s = max(SWINGS * period_s, SHORTEST_WINDOW_S)
    holding = [one for one in contacts if one[1] - one[0] >= length_s]
    end_s = holding[-1][1] if holding else contacts[-1][1]
    return max(float(t[0]), end_s - length_s), end_s


def _period_s(t: Array, position: Array) -> float | None:
    """Return the median time between rises through the middle, with a hysteresis; None for few."""
    low, middle, high = np.quantile(position, [0.1, 0.5, 0.9])
    band = 0.25 * float(high - low)
    if band <= 0.0:
        return None
    side = np.where(position > middle + band, 1.0, np.where(position < middle - band, -1.0, 0.0))
    beyond = np.flatnonzero(side)
    rises = beyond[1:][np.diff(side[beyond]) > 0]
    if rises.size < FEWEST_TURNS:
        return None
    return float(np.median(np.diff(t[rises])))
