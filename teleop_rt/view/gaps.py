"""Gaps between the rows of a recording, where no curve may be drawn across."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.charts import TIME, Chart, Curve

Array = NDArray[np.float64]
_SPACINGS = 5.0
"""Times the usual spacing of rows: a shorter gap, as of a late tick, is no wider than a line."""
_OF_SAMPLES = ("force", "filtered_force", "predicted_force", "position")
"""Columns of the slave that keep their last value while no valid sample comes."""
_FEWEST = 8
"""Spacings from which on the usual one is known."""
_MOST = 100
"""Spacings that are kept of rows which come one after the other."""


def broken_at_gaps(chart: Chart) -> Chart:
    """Return a chart over time whose lines end at a gap of their rows and begin again behind it.

    Curves over one array of x stay curves over one.
    """
    if chart.xlabel != TIME:
        return chart
    broken: dict[int, tuple[NDArray[np.intp], Array]] = {}

    def ended(curve: Curve) -> Curve:
        if curve.kind != "line":
            return curve
        if id(curve.x) not in broken:
            at = gaps(curve.x, usual_spacing(np.diff(curve.x)))
            broken[id(curve.x)] = at, np.insert(curve.x, at, 0.5 * (curve.x[at - 1] + curve.x[at]))
        at, x = broken[id(curve.x)]
        if not at.size:
            return curve
        band = None if curve.band is None else np.insert(curve.band, at, np.nan)
        return replace(curve, x=x, y=np.insert(curve.y, at, np.nan), band=band)

    panels = (
        panel if panel.xlabel else replace(panel, curves=tuple(ended(one) for one in panel.curves))
        for panel in chart.panels
    )
    return replace(chart, panels=tuple(panels))


def usual_spacing(spacings: Sequence[float] | Array) -> float:
    """Return the usual spacing of rows by the distances between them; infinite for too few."""
    return float(np.median(spacings)) if len(spacings) >= _FEWEST else np.inf


def gaps(times: Array, spacing: float) -> NDArray[np.intp]:
    """Return the rows of times (n,) before which a gap lies."""
    return np.flatnonzero(np.diff(times) > _SPACINGS * spacing) + 1


def without_held(slave: Mapping[str, Array]) -> Mapping[str, Array]:
    """Return the slave's rows with NaN for values that were held while samples were lost.

    Fewer rows than are a gap keep them: of every second sample lost no line would be left.
    """
    if "valid" not in slave:
        return slave
    edges = np.diff((slave["valid"] <= 0.0).astype(np.int8), prepend=0, append=0)
    held = np.zeros(slave["valid"].size, dtype=bool)
    for begin, end in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
        held[begin:end] = end - begin > _SPACINGS
    names = [name for name in _OF_SAMPLES if name in slave]
    return {**slave, **{name: np.where(held, np.nan, slave[name]) for name in names}}


class Breaker:
    """Puts a row of NaN into each gap of rows that come piece by piece."""

    def __init__(self) -> None:
        self._last_ns = np.nan
        self._spacings_ns: list[float] = []

    def __call__(self, rows: Mapping[str, Array]) -> Mapping[str, Array]:
        """Return the rows, at least one, with their gaps and the one before them."""
        stamps = np.concatenate(([self._last_ns], rows["stamp_ns"]))
        new = np.diff(stamps)
        self._last_ns = stamps[-1]
        self._spacings_ns = [*self._spacings_ns, *new[np.isfinite(new)]][-_MOST:]
        at = gaps(stamps, usual_spacing(self._spacings_ns)) - 1
        if not at.size:
            return rows
        broken = {name: np.insert(values, at, np.nan) for name, values in rows.items()}
        broken["stamp_ns"] = np.insert(rows["stamp_ns"], at, 0.5 * (stamps[at] + stamps[at + 1]))
        return broken
