"""The figures of a report, as SVG text: colours that colour-blind people can tell apart."""

from __future__ import annotations

import io
from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from teleop_rt.config import Units

Array = NDArray[np.float64]
Columns = Mapping[str, Array]

# Okabe and Ito 2008
MEASURED, PREDICTED, RENDERED, SHADE = "#0072B2", "#D55E00", "#009E73", "#E8E8E8"
_POINTS = 4000


def _svg(figure: Figure) -> str:
    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "teleop-rt", "svg.fonttype": "none"}):
        figure.savefig(text, format="svg", metadata={"Date": None})
    content = text.getvalue()
    return content[content.index("<svg") :]


def _legend(axes: Axes) -> None:
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def _finite(values: Array) -> Array:
    return values[np.isfinite(values)]


def _thin(columns: Columns, *names: str) -> tuple[Array, ...]:
    """Return time in s from the first row and the named columns, at most _POINTS of each."""
    step = max(1, columns["stamp_ns"].size // _POINTS)
    seconds = (columns["stamp_ns"] - columns["stamp_ns"][0]) * 1e-9
    return tuple(values[::step] for values in (seconds, *(columns[name] for name in names)))


def _shade_contact(axes: Axes, t: Array, in_contact: Array) -> None:
    edges = np.flatnonzero(np.diff(np.concatenate(([0.0], in_contact, [0.0]))))
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        axes.axvspan(t[start], t[min(end, t.size - 1)], color=SHADE, zorder=0)


def force_figure(slave: Columns, master: Columns, units: Units) -> str:
    """Force measured, predicted by the selected model, and rendered; contacts are shaded."""
    figure = Figure(figsize=(9, 5.2), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1))
    t, force, predicted, contact = _thin(slave, "force", "predicted_force", "in_contact")
    _shade_contact(upper, t, contact)
    upper.plot(t, force, color=MEASURED, label="measured (slave)", linewidth=1.6)
    upper.plot(t, predicted, color=PREDICTED, label="predicted", linewidth=0.9, linestyle="--")
    if master:
        shift = (master["stamp_ns"][0] - slave["stamp_ns"][0]) * 1e-9
        tm, rendered = _thin(master, "rendered_force")
        upper.plot(tm + shift, rendered, color=RENDERED, label="rendered (master)", linewidth=0.9)
    upper.set_ylabel(f"force [{units.force}]")
    _legend(upper)
    (filtered,) = _thin(slave, "filtered_force")[1:]
    lower.plot(t, filtered - predicted, color=PREDICTED, linewidth=0.6)
    lower.axhline(0.0, color="black", linewidth=0.5)
    lower.set_ylabel(f"residual [{units.force}]")
    lower.set_xlabel("time [s]")
    return _svg(figure)


def position_figure(slave: Columns, units: Units) -> str:
    """Position, the target of the master, and the surface that was found."""
    figure = Figure(figsize=(9, 2.8), layout="constrained")
    axes = figure.subplots()
    t, position, target, surface = _thin(slave, "position", "target", "surface")
    axes.plot(t, target, color=RENDERED, linewidth=0.9, label="asked for by the master")
    axes.plot(t, position, color=MEASURED, linewidth=1.2, label="measured")
    axes.plot(t, surface, color=PREDICTED, linewidth=1.0, linestyle="--", label="surface found")
    axes.set_ylabel(f"position [{units.position}]")
    axes.set_xlabel("time [s]")
    _legend(axes)
    return _svg(figure)


def timing_figure(slave: Columns, period_s: float) -> str | None:
    """Histogram of wake latency and work against the deadline; None on simulated time."""
    latency, work = (
        slave[name][np.isfinite(slave[name])] for name in ("wake_latency_us", "work_us")
    )
    if latency.size == 0 or work.size == 0:
        return None
    figure = Figure(figsize=(9, 2.8), layout="constrained")
    axes = figure.subplots()
    bins = np.geomspace(1.0, max(2e6 * period_s, latency.max(), work.max()), 80).tolist()
    axes.hist(latency, bins=bins, color=MEASURED, alpha=0.7, label="wake latency")
    axes.hist(work, bins=bins, color=PREDICTED, alpha=0.7, label="work")
    axes.axvline(period_s * 1e6, color="black", linewidth=1.0, label="period")
    axes.set(xscale="log", yscale="log", xlabel="time [us]", ylabel="ticks")
    _legend(axes)
    return _svg(figure)
