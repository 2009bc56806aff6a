"""Charts of the machine around a trial: residuals' whiteness, link, loop timing and energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.charts import (
    TIME,
    WHOLE,
    Chart,
    Curve,
    Panel,
)
from teleop_rt.view.delay import Delays
from teleop_rt.view.residual import Whiteness
from teleop_rt.view.run_folder import Run
from teleop_rt.view.run_times import seconds, span
from teleop_rt.view.style import (
    LIGHT,
)

Array = NDArray[np.float64]


def whiteness_chart(found: Whiteness) -> Chart:
    """Return the autocorrelation of the residual, with the bounds that hold 95 % of white noise."""
    lags: Array = 1e3 * found.spacing_s * np.arange(1.0, found.correlation.size + 1.0)
    bars = Curve(
        label="autocorrelation",
        x=lags,
        y=found.correlation,
        colour=LIGHT.residual,
        kind="bars",
        bar_width=np.full(lags.size, 0.3e3 * found.spacing_s),
    )
    largest = max(3.0 * found.bound, 1.1 * float(np.max(np.abs(found.correlation))))
    limit = min(1.05, largest)
    panel = Panel(
        ylabel="autocorrelation",
        curves=(bars,),
        limits=(-limit, limit),
        zero=True,
        range_=("95 % of white noise", (-found.bound, found.bound)),
    )
    label = "autocorrelation of the residual"
    return Chart(name="whiteness", label=label, xlabel="lag [ms]", panels=(panel,))


def link_chart(run: Run, delays: Delays) -> Chart:
    """Return the one-way delay of each model message."""
    sent_s = (delays.sent_ns - run.start_ns) * 1e-9
    arrived = np.isfinite(delays.delay_ms)
    came = Curve(
        label="arrived",
        x=sent_s[arrived],
        y=delays.delay_ms[arrived],
        colour=LIGHT.measured,
        kind="points",
        width=3.0,
    )
    never = Curve(
        label="lost, or overtaken by a newer one",
        x=sent_s[~arrived],
        y=np.zeros(np.count_nonzero(~arrived)),
        colour=LIGHT.predicted,
        kind="ticks",
        width=9.0,
    )
    most = float(np.nanmax(delays.delay_ms, initial=0.0))
    panel = Panel(
        ylabel="slave to master [ms]",
        curves=(came, never) if never.x.size else (came,),
        limits=(-0.05 * (1.0 + most), 1.1 * most + 1.0),
    )
    return Chart(
        name="link",
        label="delay of the models sent",
        xlabel=TIME,
        panels=(panel,),
        limits=span(run),
        linked=WHOLE,
    )


def timing_chart(run: Run) -> Chart | None:
    """Return a histogram of wake latency and work against the deadline; None on simulated time."""
    shown = {
        name: run.slave[name][np.isfinite(run.slave[name])]
        for name in ("wake_latency_us", "work_us")
    }
    if any(values.size == 0 for values in shown.values()):
        return None
    deadline_us = run.period_s * 1e6
    largest = max(2.0 * deadline_us, *(float(values.max()) for values in shown.values()))
    edges: Array = np.geomspace(1.0, 1.01 * largest, 80, dtype=np.float64)
    curves = tuple(
        _bars(name.removesuffix("_us").replace("_", " "), values, edges, colour)
        for (name, values), colour in zip(
            shown.items(), (LIGHT.measured, LIGHT.target), strict=True
        )
    )
    panel = Panel(
        ylabel="ticks",
        curves=curves,
        limits=(0.5, 2.0 * max(float(curve.y.max()) for curve in curves)),
        logarithmic=True,
        lines=(("deadline: the period", deadline_us),),
    )
    return Chart(
        name="timing",
        label="wake latency and work",
        xlabel="time [µs]",
        panels=(panel,),
        limits=(float(edges[0]), float(edges[-1])),
        logarithmic=True,
    )


def _bars(label: str, values: Array, edges: Array, colour: str) -> Curve:
    """Return a histogram of the values (n,) in bins with these edges, as wide as these are."""
    counts, _ = np.histogram(np.maximum(values, edges[0]), bins=edges)
    some = counts > 0
    return Curve(
        label=label,
        x=np.sqrt(edges[1:] * edges[:-1])[some],
        y=counts[some].astype(np.float64),
        colour=colour,
        kind="bars",
        bar_width=np.diff(edges)[some],
        faint=True,
    )


def energy_chart(run: Run) -> Chart | None:
    """Return the energy at the operator's port and that of adopting walls; None without master."""
    if not run.master:
        return None
    t = seconds(run, run.master)
    port, adoption = run.master["port_energy"], run.master["adoption_energy"]
    given = Curve(
        label="given by the hand (observed)", x=t, y=port, colour=LIGHT.rendered, width=1.4
    )
    spent = Curve(
        label="spent on adopting walls",
        x=t,
        y=adoption,
        colour=LIGHT.predicted,
        width=1.4,
        style="dashed",
    )
    return Chart(
        name="energy",
        label="energy at the operator's port",
        xlabel=TIME,
        panels=(Panel(ylabel="energy [J]", curves=(given, spent), zero=True),),
        limits=span(run),
        linked=WHOLE,
    )
