"""The figures of a run's report, as SVG text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from teleop_rt.view.delay import Delays
from teleop_rt.view.plots import (
    blank,
    legend,
    line,
    seconds,
    settled_limits,
    shade_contact,
    svg,
)
from teleop_rt.view.quantities import SMALL, parameter_unit, small
from teleop_rt.view.residual import Whiteness
from teleop_rt.view.run_folder import Run
from teleop_rt.view.style import (
    ASKED,
    COLOURS,
    LIGHT,
    MEASURED,
    PREDICTED,
    RENDERED,
    RESIDUAL,
    STYLES,
    SURFACE,
    method_name,
    model_name,
)

Array = NDArray[np.float64]
Limits = tuple[float, float]
_CLOSE_S = 1.5
_TIME = "time [s], contacts shaded"
_UNKNOWN = (0.0, 3.0)
"""Statuses `warming up` and `restarted`: what an estimator holds then is no estimate."""


def span(run: Run) -> Limits:
    """Return the ends of every time axis [s]: the slave's first tick and its last.

    The master begins to record before, and waits.
    """
    return 0.0, float(seconds(run.slave, run.start_ns)[-1]) or run.period_s


def force_figure(run: Run, limits: Limits | None = None) -> str:
    """Force measured, predicted by the selected model and rendered; below, what is left."""
    figure, (upper, lower) = blank(5.0, 2, sharex=True, height_ratios=(3, 1))
    slave, master = run.slave, run.master
    t = seconds(slave, run.start_ns)
    for axes in (upper, lower):
        shade_contact(axes, t, slave["in_contact"])
    line(upper, t, slave["force"], color=LIGHT.measured, label=MEASURED, linewidth=1.8)
    line(
        upper,
        t,
        slave["predicted_force"],
        color=LIGHT.predicted,
        label=PREDICTED,
        linewidth=0.9,
        linestyle="--",
    )
    if master:
        rendered = master["rendered_force"]
        tm = seconds(master, run.start_ns)
        line(upper, tm, rendered, color=LIGHT.rendered, label=RENDERED, linewidth=0.9)
    upper.set_ylabel(f"force [{run.units.force}]")
    upper.set_ylim(limits)
    stopped = np.flatnonzero(slave["fault"] > 0)
    for axes in (upper, lower) if stopped.size else ():
        axes.axvline(t[stopped[0]], color=LIGHT.bad, linewidth=1.6, linestyle=":", label="fault")
    legend(upper)
    line(lower, t, run.residual, color=LIGHT.residual, linewidth=0.7, label=RESIDUAL)
    lower.axhline(0.0, color="black", linewidth=0.5)
    lower.set(ylabel=f"residual [{run.units.force}]", xlabel=_TIME, xlim=span(run))
    return svg(figure, "force over time")


def close_force_figure(run: Run) -> str | None:
    """Force in the last second and a half of contact, close enough to tell the three apart."""
    touching = np.flatnonzero(run.slave["in_contact"] > 0)
    if touching.size == 0:
        return None
    end_s = float(seconds(run.slave, run.start_ns)[touching[-1]])
    figure, (axes,) = blank(2.8)
    forces = [
        (run.slave, "force", LIGHT.measured, "-", 2.2, MEASURED),
        (run.slave, "predicted_force", LIGHT.predicted, "--", 1.3, PREDICTED),
    ]
    if run.master:
        forces.append((run.master, "rendered_force", LIGHT.rendered, "-", 1.3, RENDERED))
    for columns, name, colour, style, width, label in forces:
        t = seconds(columns, run.start_ns)
        near = (t >= end_s - _CLOSE_S) & (t <= end_s + 0.1)
        values = columns[name][near]
        axes.plot(t[near], values, color=colour, linestyle=style, linewidth=width, label=label)
    axes.set(ylabel=f"force [{run.units.force}]", xlabel="time [s]")
    legend(axes)
    return svg(figure, "force at the end of the last contact")


def position_figure(run: Run) -> str:
    """Position, the target of the master, and the surface that was found."""
    figure, (axes,) = blank(2.6)
    slave = run.slave
    t = seconds(slave, run.start_ns)
    shade_contact(axes, t, slave["in_contact"])
    target, position, surface = (SMALL * slave[name] for name in ("target", "position", "surface"))
    line(axes, t, target, color=LIGHT.target, linewidth=2.4, label=ASKED)
    line(axes, t, position, color=LIGHT.measured, linewidth=1.0, label=MEASURED)
    line(axes, t, surface, color=LIGHT.predicted, linewidth=1.2, linestyle="--", label=SURFACE)
    axes.set(ylabel=f"position [{small(run.units.position)}]", xlabel=_TIME, xlim=span(run))
    legend(axes)
    return svg(figure, "position over time")


def estimate_figures(run: Run) -> dict[str, str]:
    """Return `{model: figure}`: each parameter over time with two standard deviations either way.

    One line for each regression and solver that ran; no figure of a model without an estimate.
    """
    models: dict[str, list[str]] = {}
    for topic, columns in sorted(run.topics.items()):
        if topic.startswith("/estimates/") and not np.all(np.isin(columns["status"], _UNKNOWN)):
            models.setdefault(topic.split("/")[2], []).append(topic)
    chosen = (run.summary["selected"] or {}).get("model")
    order = sorted(models, key=lambda model: (model != chosen, model))
    return {model_name(model): _estimates(run, model, models[model]) for model in order}


def _estimates(run: Run, model: str, topics: list[str]) -> str:
    names = list(dict.fromkeys(name for topic in topics for name in _parameters(run, topic)))
    figure, panels = blank(0.5 + 1.6 * len(names), len(names), sharex=True)
    t_slave = seconds(run.slave, run.start_ns)
    for axes, name in zip(panels, names, strict=True):
        shade_contact(axes, t_slave, run.slave["in_contact"])
        shown = []
        for place, topic in enumerate(topics):
            if name in _parameters(run, topic):
                shown.append(_estimate(run, axes, place, topic, name))
        unit = parameter_unit(model, name, run.units.position, run.units.force)
        axes.set_ylabel(f"{name} [{unit}]")
        axes.set_ylim(settled_limits(shown))
    legend(panels[0])
    panels[-1].set(xlabel=f"{_TIME}; bands are two standard deviations", xlim=span(run))
    return svg(figure, f"parameters of {model_name(model)} over time")


def _estimate(run: Run, axes: Axes, place: int, topic: str, name: str) -> Array:
    """Plot one parameter of one estimator with its band; return what was plotted."""
    columns = run.topics[topic]
    _, _, _, regression, solver = topic.split("/")
    unknown = np.isin(columns["status"], _UNKNOWN)
    values = np.where(unknown, np.nan, columns[name])
    spread = np.where(unknown, np.nan, columns[f"{name}_std"])
    t = seconds(columns, run.start_ns)
    colour = COLOURS[place % len(COLOURS)]
    style = STYLES[place // len(COLOURS) % len(STYLES)]
    step = max(1, t.size // 1500)
    axes.fill_between(
        t[::step],
        (values - 2.0 * spread)[::step],
        (values + 2.0 * spread)[::step],
        color=colour,
        alpha=0.2,
        linewidth=0.0,
    )
    line(axes, t, values, color=colour, linestyle=style, label=method_name(regression, solver))
    return values


def _parameters(run: Run, topic: str) -> Iterator[str]:
    columns = run.topics[topic]
    return (name for name in columns if f"{name}_std" in columns and name != "offset")


def whiteness_figure(found: Whiteness) -> str:
    """Autocorrelation of the residual, with the bounds that hold 95 % of white noise."""
    figure, (axes,) = blank(2.0)
    lags = 1e3 * found.spacing_s * np.arange(1, found.correlation.size + 1)
    axes.axhspan(-found.bound, found.bound, color=LIGHT.shade, label="95 % of white noise")
    axes.vlines(lags, 0.0, found.correlation, color=LIGHT.residual, linewidth=2.5)
    axes.axhline(0.0, color="black", linewidth=0.5)
    largest = max(3.0 * found.bound, 1.1 * float(np.max(np.abs(found.correlation))))
    limit = min(1.05, largest)
    axes.set(xlabel="lag [ms]", ylabel="autocorrelation", ylim=(-limit, limit))
    legend(axes)
    return svg(figure, "autocorrelation of the residual")


def link_figure(run: Run, delays: Delays) -> str:
    """One-way delay of each model message, and its spread."""
    figure, (left, right) = blank(2.6, columns=2, width_ratios=(4, 1), sharey=True)
    sent_s = (delays.sent_ns - run.start_ns) * 1e-9
    arrived = np.isfinite(delays.delay_ms)
    left.plot(sent_s, delays.delay_ms, ".", ms=3, color=LIGHT.measured, label="arrived")
    left.plot(
        sent_s[~arrived],
        np.full(np.count_nonzero(~arrived), 0.0),
        "|",
        ms=9,
        color=LIGHT.predicted,
        label="lost, or overtaken by a newer one",
    )
    left.set(xlabel="time [s]", ylabel="slave to master [ms]", xlim=span(run))
    left.set_ylim(bottom=-0.03 * (1.0 + float(np.nanmax(delays.delay_ms, initial=0.0))))
    legend(left)
    right.hist(delays.delay_ms[arrived], bins=40, orientation="horizontal", color=LIGHT.measured)
    right.set_xlabel("messages")
    return svg(figure, "delay of the models sent")


def timing_figure(run: Run) -> str | None:
    """Histogram of wake latency and work against the deadline; None on simulated time."""
    shown: Mapping[str, Array] = {
        name: run.slave[name][np.isfinite(run.slave[name])]
        for name in ("wake_latency_us", "work_us")
    }
    if any(values.size == 0 for values in shown.values()):
        return None
    figure, (axes,) = blank(2.6)
    deadline_us = run.period_s * 1e6
    largest = max(2.0 * deadline_us, *(float(values.max()) for values in shown.values()))
    bins = np.geomspace(1.0, largest, 80).tolist()
    for (name, values), colour, hatch in zip(
        shown.items(), (LIGHT.measured, LIGHT.target), ("", "////"), strict=True
    ):
        label = name.removesuffix("_us").replace("_", " ")
        axes.hist(values, bins=bins, color=colour, alpha=0.65, label=label, hatch=hatch)
    axes.axvline(deadline_us, color=LIGHT.predicted, linewidth=1.6, label="deadline: the period")
    axes.set(xscale="log", yscale="log", xlabel="time [µs]", ylabel="ticks")
    legend(axes)
    return svg(figure, "wake latency and work")


def energy_figure(run: Run) -> str | None:
    """Energy seen at the operator's port, and spent on adopting walls; None without a master."""
    if not run.master:
        return None
    figure, (axes,) = blank(2.4)
    t = seconds(run.master, run.start_ns)
    port, adoption = run.master["port_energy"], run.master["adoption_energy"]
    line(axes, t, port, color=LIGHT.rendered, label="given by the hand (observed)")
    line(
        axes,
        t,
        adoption,
        color=LIGHT.predicted,
        linestyle="--",
        label="spent on adopting walls",
    )
    axes.axhline(0.0, color="black", linewidth=0.5)
    axes.set(xlabel="time [s]", ylabel="energy [J]", xlim=span(run))
    legend(axes)
    return svg(figure, "energy at the operator's port")
