"""The figure of a diagnosis: the residual before and after, seen from six sides."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.answers.residuals import Residuals
from teleop_rt.view.quantities import SMALL, small
from teleop_rt.view.style import BLUE, VERMILLION

_MOST_POINTS = 4000  # per panel; more overlap, and make the SVG too large to open


_LOOKS = {"before": (VERMILLION, "--"), "after": (BLUE, "-")}


def residual_figure(residuals: Residuals) -> Figure:
    """Return the residual against x, velocity, time and phase, its spectrum and histogram.

    Where no effect was added there is one residual only.
    """
    position, force = residuals.units
    shown = [(name, *_LOOKS[name], row) for name, row in residuals.by_name().items()]
    sides = {
        f"penetration x [{small(position)}]": SMALL * residuals.x,
        f"velocity [{small(position)}/s]": SMALL * residuals.v,
        "time [s]": residuals.t,
        "phase of the motion [rad]": np.arctan2(_scaled(residuals.v), _scaled(residuals.x)),
    }
    with mpl.rc_context({"font.size": 9.0, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(10.0, 8.5), layout="constrained")
        axes = figure.subplots(3, 2).ravel()
        thin = slice(None, None, 1 + residuals.t.size // _MOST_POINTS)
        for axis, (label, row) in zip(axes, sides.items(), strict=False):
            for name, colour, _, residual in shown:
                axis.plot(row[thin], residual[thin], ".", ms=1.5, color=colour, label=name)
            axis.locator_params(axis="x", nbins=7)
            axis.set(xlabel=label, ylabel=f"residual [{force}]")
        for name, colour, dash, residual in shown:
            _spectrum(axes[4], residual, residuals.dt, color=colour, linestyle=dash, label=name)
            axes[5].hist(residual, bins=80, histtype="step", color=colour, linestyle=dash)
        axes[4].set(xlabel="frequency [Hz]", ylabel=f"power density [{force}²/Hz]")
        axes[5].set(xlabel=f"residual [{force}]", ylabel="samples")
        lines = [axes[4].lines[place] for place in range(len(shown))]
        if len(shown) > 1:
            names = [name for name, *_ in shown]
            figure.legend(lines, names, loc="outside upper left", ncols=2, frameon=False)
    return figure


def _scaled(row: Vector) -> Vector:
    scaled: Vector = (row - np.mean(row)) / max(float(np.std(row)), 1e-300)
    return scaled


def _spectrum(axis: Axes, residual: Vector, dt: float, **look: str) -> None:
    frequency, power = scipy.signal.welch(residual, fs=1.0 / dt, nperseg=min(2048, residual.size))
    axis.loglog(frequency[1:], power[1:], lw=1.0, **look)
