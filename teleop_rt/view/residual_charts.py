"""The residual of a diagnosis: over time, motion, phase and frequency."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy
from numpy.typing import NDArray

from teleop_rt.diagnosis.answers.residuals import Residuals
from teleop_rt.view.charts import Chart, Curve, Panel, few_swings, robust_limits
from teleop_rt.view.quantities import SMALL, small
from teleop_rt.view.style import BLUE, VERMILLION, Style

Array = NDArray[np.float64]

_MOST_POINTS = 4000  # of a cloud: more only darken it
_BINS = 80
"""Of the histogram of a residual."""
_SEGMENT = 2048  # samples of a spectrum's segment
_LOOKS: Mapping[str, tuple[str, Style]] = {
    "before": (VERMILLION, "dashed"),
    "after": (BLUE, "solid"),
}


def residual_charts(found: Residuals) -> list[Chart]:
    """Return the charts of the residuals along their motion."""
    position, force = found.units
    t, x, v, residuals = found.t, found.x, found.v, found.by_name()
    ylabel = f"residual [{force}]"
    thin = slice(None, None, 1 + t.size // _MOST_POINTS)
    phase = np.arctan2(_scaled(v), _scaled(x))
    sides = [
        (f"penetration x [{small(position)}]", SMALL * x),
        (f"velocity [{small(position)}/s]", SMALL * v),
        ("phase of the motion [rad]", phase),
    ]
    clouds = [
        Panel(ylabel=ylabel, xlabel=xlabel, curves=_cloud(row[thin], residuals, thin), zero=True)
        for xlabel, row in sides
    ]
    histogram = Panel(ylabel="samples", xlabel=ylabel, curves=_histograms(residuals))
    return [
        _over_time(t, x, residuals, ylabel),
        _pair("motion", "residual over penetration and velocity", clouds[0], clouds[1]),
        _pair("phase", "residual over the motion's phase, and its histogram", clouds[2], histogram),
        _spectrum(t, residuals, force),
    ]


def _pair(name: str, label: str, left: Panel, right: Panel) -> Chart:
    panels = (left, right)
    return Chart(name=name, label=label, xlabel=left.xlabel or "", panels=panels, beside=(1, 1))


def _scaled(row: Array) -> Array:
    scaled: Array = (row - np.mean(row)) / max(float(np.std(row)), 1e-300)
    return scaled


def _cloud(x: Array, residuals: Mapping[str, Array], thin: slice) -> tuple[Curve, ...]:
    return tuple(
        Curve(label=name, x=x, y=row[thin], colour=_LOOKS[name][0], kind="points", width=2.0)
        for name, row in residuals.items()
    )


def _over_time(t: Array, x: Array, residuals: Mapping[str, Array], ylabel: str) -> Chart:
    """Return the residual over time, a few swings at first; gaps between contacts stay gaps."""
    dt = float(np.median(np.diff(t)))
    gaps = np.flatnonzero(np.diff(t) > 1.5 * dt) + 1
    times = np.insert(t, gaps, np.nan)
    curves = tuple(
        Curve(
            label=name,
            x=times,
            y=np.insert(row, gaps, np.nan),
            colour=_LOOKS[name][0],
            style=_LOOKS[name][1],
            width=1.3,
        )
        for name, row in residuals.items()
    )
    limits, spikes = robust_limits(t, residuals["before"])
    panel = Panel(ylabel=ylabel, curves=curves, limits=limits, spikes=spikes, zero=True)
    return Chart(
        name="time",
        label="residual over time",
        xlabel="time [s]",
        panels=(panel,),
        limits=(float(t[0]), float(t[-1])),
        window=few_swings(t, x, np.ones(t.size)),
    )


def _histograms(residuals: Mapping[str, Array]) -> tuple[Curve, ...]:
    curves = []
    for name, row in residuals.items():
        counts, edges = np.histogram(row, bins=_BINS)
        colour, style = _LOOKS[name]
        middles: Array = 0.5 * (edges[1:] + edges[:-1])
        y = counts.astype(np.float64)
        curves.append(Curve(label=name, x=middles, y=y, colour=colour, style=style, width=1.5))
    return tuple(curves)


def _spectrum(t: Array, residuals: Mapping[str, Array], force: str) -> Chart:
    curves = []
    for name, row in residuals.items():
        frequency, power = scipy.signal.welch(
            row, fs=1.0 / float(np.median(np.diff(t))), nperseg=min(_SEGMENT, row.size)
        )
        colour, style = _LOOKS[name]
        x, y = frequency[1:], power[1:]
        curves.append(Curve(label=name, x=x, y=y, colour=colour, style=style, width=1.3))
    panel = Panel(ylabel=f"power density [{force}²/Hz]", curves=tuple(curves), logarithmic=True)
    return Chart(
        name="spectrum",
        label="spectrum of the residual",
        xlabel="frequency [Hz]",
        panels=(panel,),
        logarithmic=True,
    )
