"""The figures of a run's report, as charts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from teleop_rt.view.charts import (
    NEAR,
    TIME,
    WHOLE,
    Chart,
    Curve,
    Panel,
    robust_limits,
    settled_limits,
)
from teleop_rt.view.delay import Delays
from teleop_rt.view.machine_figures import energy_chart, link_chart, timing_chart, whiteness_chart
from teleop_rt.view.quantities import SMALL, parameter_unit, small
from teleop_rt.view.residual import Whiteness
from teleop_rt.view.run_folder import Columns, Run
from teleop_rt.view.run_times import UNKNOWN, contacts, seconds, span, window
from teleop_rt.view.style import (
    ASKED,
    COLOURS,
    DASHES,
    FELT,
    FILTERED,
    LIGHT,
    MEASURED,
    PREDICTED,
    RAW,
    REFLECTED,
    RENDERED,
    RESIDUAL,
    SURFACE,
    TRUE_FORCE,
    Style,
    method_name,
    model_name,
    with_unit,
)

Array = NDArray[np.float64]


def charts(run: Run, whiteness: Whiteness | None, delays: Delays | None) -> list[Chart]:
    """Return every figure that the recording of a run has the data for."""
    found = [felt_chart(run), force_chart(run), position_chart(run), *estimate_charts(run)]
    found += [None if whiteness is None else whiteness_chart(whiteness)]
    found += [None if delays is None else link_chart(run, delays)]
    found += [timing_chart(run), energy_chart(run)]
    return [chart for chart in found if chart is not None]


def felt_chart(run: Run) -> Chart | None:
    """Return the felt force over the true one beside the slave's force, reflected; None unknown."""
    felt = run.felt
    if felt is None or not felt.converged.any():
        return None
    t, unit = (felt.stamp_ns - run.start_ns) * 1e-9, run.units.force
    start, end = window(run)
    shown = felt.converged & (t >= start) & (t <= end) & np.isfinite(felt.true)
    if not shown.any():
        return None
    signals: tuple[tuple[str, Array, str, float, Style], ...] = (
        (FELT, felt.rendered, LIGHT.rendered, 1.6, "solid"),
        (REFLECTED, felt.reflected, LIGHT.predicted, 1.4, "dashed"),
    )
    over_time = tuple(
        Curve(label=label, x=t, y=y, colour=colour, width=width, style=style)
        for label, y, colour, width, style in signals
    )
    over_true = tuple(
        Curve(label=label, x=felt.true[shown], y=y[shown], colour=colour, width=width, style=style)
        for label, y, colour, width, style in signals
    )
    diagonal = np.array([0.0, float(np.max(felt.true[shown]))])
    return Chart(
        name="felt",
        label="felt force over the true force, with the delayed reflection beside it",
        xlabel=TIME,
        panels=(
            Panel(ylabel=f"force [{unit}]", curves=(_true(t, felt.true), *over_time)),
            Panel(
                ylabel=f"force under the hand [{unit}]",
                curves=(_true(diagonal, diagonal), *over_true),
                equal=True,
                xlabel=f"true force [{unit}]",
            ),
        ),
        limits=(start, end),
        beside=(2, 1),
    )


def _true(x: Array, y: Array) -> Curve:
    return Curve(label=TRUE_FORCE, x=x, y=y, colour=LIGHT.measured, width=8.0, faint=True)


def force_chart(run: Run) -> Chart:
    """Return force measured and predicted behind the same filter, and their difference."""
    slave, t = run.slave, seconds(run, run.slave)
    limits, spikes = robust_limits(t, run.residual)
    left = Curve(label=RESIDUAL, x=t, y=run.residual, colour=LIGHT.residual)
    stopped = np.flatnonzero(slave["fault"] > 0)
    fault = (("fault", float(t[stopped[0]])),) if stopped.size else ()
    unit = run.units.force
    return Chart(
        name="force",
        label="force over time",
        xlabel=TIME,
        panels=(
            Panel(ylabel=f"force [{unit}]", curves=_forces(run, t), height=3.0, lines=fault),
            Panel(
                ylabel=f"residual [{unit}]",
                curves=(left,),
                limits=limits,
                spikes=spikes,
                zero=True,
                lines=fault,
            ),
        ),
        limits=span(run),
        window=window(run),
        shaded=contacts(run),
        linked=NEAR,
        notes=_spike_note(spikes, unit),
    )


def _forces(run: Run, t: Array) -> tuple[Curve, ...]:
    """Return the slave's forces over its times t (n,), and the one that the master rendered."""
    slave = run.slave
    forces = [
        Curve(label=RAW, x=t, y=slave["force"], colour=LIGHT.measured, faint=True),
        Curve(label=FILTERED, x=t, y=slave["filtered_force"], colour=LIGHT.measured, width=3.2),
        Curve(
            label=PREDICTED,
            x=t,
            y=slave["predicted_force"],
            colour=LIGHT.predicted,
            width=1.4,
            style="dashed",
        ),
    ]
    if run.master:
        tm, rendered = seconds(run, run.master), run.master["rendered_force"]
        forces.append(Curve(label=RENDERED, x=tm, y=rendered, colour=LIGHT.rendered, width=1.2))
    return tuple(forces)


def _spike_note(spikes: Sequence[tuple[float, float]], unit: str) -> tuple[str, ...]:
    if not spikes:
        return ()
    at_s, size = max(spikes, key=lambda one: abs(one[1]))
    many = "1 spike" if len(spikes) == 1 else f"{len(spikes)} spikes"
    largest = f"the largest {with_unit(size, unit, 3)} at {at_s:.3f} s"
    return (f"▲▼ mark {many} of the residual beyond its scale, {largest}.",)


def position_chart(run: Run) -> Chart:
    """Return position, the target of the master, and the surface that was found."""
    t = seconds(run, run.slave)
    shown: tuple[tuple[str, str, str, float, Style], ...] = (
        (ASKED, "target", LIGHT.target, 2.6, "solid"),
        (MEASURED, "position", LIGHT.measured, 1.2, "solid"),
        (SURFACE, "surface", LIGHT.predicted, 1.2, "dashed"),
    )
    curves = tuple(
        Curve(label=label, x=t, y=SMALL * run.slave[name], colour=c, width=width, style=style)
        for label, name, c, width, style in shown
    )
    return Chart(
        name="position",
        label="position over time",
        xlabel=TIME,
        panels=(Panel(ylabel=f"position [{small(run.units.position)}]", curves=curves),),
        limits=span(run),
        window=window(run),
        shaded=contacts(run),
        linked=NEAR,
    )


def estimate_charts(run: Run) -> list[Chart]:
    """Return a chart for each model: its parameters with two standard deviations either way.

    One curve for each regression and solver that ran; no chart of a model without an estimate.
    """
    models: dict[str, list[str]] = {}
    for topic, columns in sorted(run.topics.items()):
        if topic.startswith("/estimates/") and not np.all(np.isin(columns["status"], UNKNOWN)):
            models.setdefault(topic.split("/")[2], []).append(topic)
    chosen = (run.summary["selected"] or {}).get("model")
    order = sorted(models, key=lambda model: (model != chosen, model))
    return [_estimates(run, model, models[model]) for model in order]


def _estimates(run: Run, model: str, topics: list[str]) -> Chart:
    names = dict.fromkeys(name for topic in topics for name in _parameters(run, topic))
    times = {topic: seconds(run, run.topics[topic]) for topic in topics}
    panels = []
    for name in names:
        curves = tuple(
            _estimate(run.topics[topic], times[topic], place, topic, name)
            for place, topic in enumerate(topics)
            if name in _parameters(run, topic)
        )
        unit = parameter_unit(model, name, run.units.position, run.units.force)
        limits = settled_limits([curve.y for curve in curves])
        panels.append(Panel(ylabel=f"{name} [{unit}]", curves=curves, limits=limits))
    return Chart(
        name=f"parameters-{model}",
        label=f"parameters of {model_name(model)} over time",
        xlabel=TIME,
        panels=tuple(panels),
        limits=span(run),
        shaded=contacts(run),
        linked=WHOLE,
        notes=("Bands are two standard deviations either way.",),
    )


def _estimate(columns: Columns, t: Array, place: int, topic: str, name: str) -> Curve:
    _, _, _, regression, solver = topic.split("/")
    unknown = np.isin(columns["status"], UNKNOWN)
    return Curve(
        label=method_name(regression, solver),
        x=t,
        y=np.where(unknown, np.nan, columns[name]),
        band=np.where(unknown, np.nan, 2.0 * columns[f"{name}_std"]),
        colour=COLOURS[place % len(COLOURS)],
        style=DASHES[place // len(COLOURS) % len(DASHES)],
        width=1.4,
    )


def _parameters(run: Run, topic: str) -> Iterator[str]:
    columns = run.topics[topic]
    return (name for name in columns if f"{name}_std" in columns and name != "offset")
