"""Several runs on one page: their results, their differences, and their curves overlaid."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from string import ascii_uppercase
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.metrics import in_percent
from teleop_rt.trial.felt_force import read_truth
from teleop_rt.trial.grades import Grade, grades, lost_share, of_error, selected_nrmse, worst
from teleop_rt.view.charts import Chart, Curve, Panel, robust_limits, settled_limits
from teleop_rt.view.quantities import SMALL, parameter_unit, small
from teleop_rt.view.run_folder import Run, selected_row
from teleop_rt.view.run_times import UNKNOWN, seconds, span, window
from teleop_rt.view.style import COLOURS, DASHES, method_name, model_name, number, printed

Array = NDArray[np.float64]
_SAME_SHARE = 1e-3  # relative; figures closer together than this are called the same


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of one run: its text, its sort key, its grade, and its change.

    `change` is relative to the first run, only for a figure with a natural zero; `better` states
    whether it is an improvement, None if neither is better.
    """

    text: str
    sort: float | str
    grade: Grade | None = None
    change: str = ""
    better: bool | None = None


def letters(count: int) -> list[str]:
    """Return short names of runs: A, B, ..., Z, A2, B2, ..."""
    names = len(ascii_uppercase)
    return [
        ascii_uppercase[i % names] + (str(i // names + 1) if i >= names else "")
        for i in range(count)
    ]


def compared(runs: Sequence[Run]) -> tuple[list[str], list[list[Figure]]]:
    """Return the headings of a table, and a row for each run with a figure below each heading."""
    figures = [dict(_figures(run)) for run in runs]
    headings = list(dict.fromkeys(name for one in figures for name in one))
    first = figures[0]
    rows = [
        [_against(one.get(name, _Raw("–")), first.get(name)) for name in headings]
        for one in figures
    ]
    return headings, rows


@dataclass(frozen=True, slots=True)
class _Raw:
    """A figure before it is compared: `ratio` where percentages mean something."""

    text: str
    value: float | None = None
    grade: Grade | None = None
    ratio: bool = False
    less_is_better: bool = False


def _against(own: _Raw, first: _Raw | None) -> Figure:
    """Return a figure with its change against the first run's."""
    sort: float | str = own.text if own.value is None else own.value
    if first is None or first is own or own.value is None or first.value is None:
        return Figure(own.text, sort, own.grade)
    a, b = first.value, own.value
    same = abs(b - a) <= _SAME_SHARE * max(abs(a), abs(b))
    better = None if same or not own.less_is_better else abs(b) < abs(a)
    change = "" if not own.ratio or not a else "same" if same else _percent(b / a)
    return Figure(own.text, sort, own.grade, change, better)


def _percent(ratio: float) -> str:
    """Return a ratio as a percentage where it is small, else as a factor."""
    if 0.5 < ratio < 2.0:
        return f"{'+' if ratio > 1.0 else ''}{in_percent(ratio - 1.0)}"
    return f"× {ratio:.2g}" if abs(ratio) < 99.5 else f"× {ratio:.0f}"


def _figures(run: Run) -> Iterator[tuple[str, _Raw]]:
    summary, graded = run.summary, grades(run.summary)
    safety, master, link = summary["safety"], summary["master"], summary["link"]
    yield "ended", _Raw(_ended(safety), None, graded["safety"])
    yield from _model_figures(summary, graded["model"])
    error = selected_nrmse(summary)
    yield "model error", _share(error, worst([of_error(error), graded["model"]]))
    yield "felt error", _share(master["nrmse"], graded["felt_force"])
    lag = master["lag_ms"]
    yield (
        "felt lag [ms]",
        _Raw(number(lag, 2), lag, graded["felt_force"], less_is_better=True),
    )
    step = master["largest_force_step"]
    heading = f"force step [{run.units.force}]"
    yield heading, _Raw(number(step, 3), step, ratio=True, less_is_better=True)
    surface = summary["contact"]["surface_found"]
    found = None if surface is None else SMALL * surface
    yield f"surface [{small(run.units.position)}]", _Raw(number(found, 5), found)
    trip = link["round_trip_ms"]
    yield "round trip [ms]", _Raw(number(trip, 4), trip, graded["link"])
    share = lost_share(link)
    yield "lost", _share(share, graded["link"], ratio=False)
    yield from _loop_figures(summary, graded["loop"])


def _model_figures(summary: Mapping[str, Any], grade: Grade) -> Iterator[tuple[str, _Raw]]:
    """Yield the selected model, and each of its parameters."""
    chosen = selected_row(summary)
    if chosen is None:
        yield "model", _Raw("none", None, grade)
    else:
        method = method_name(chosen["regression"], chosen["solver"])
        yield (
            "model",
            _Raw(f"{model_name(chosen['model'])}, {method}", None, grade),
        )
        for name, parameter in chosen["parameters"].items():
            heading = f"{name} [{printed(parameter['unit'])}]"
            yield (
                heading,
                _Raw(number(parameter["value"], 5), parameter["value"], ratio=True),
            )


def _loop_figures(summary: Mapping[str, Any], grade: Grade) -> Iterator[tuple[str, _Raw]]:
    """Yield missed ticks and the latencies of the slave's loop, where a real clock shows them."""
    missed = summary["missed_ticks"]
    yield (
        "ticks missed",
        _Raw(number(missed), None if missed is None else float(missed), grade),
    )
    for name in ("wake_latency_us", "work_us"):
        if summary[name] is not None:
            value = summary[name]["p99"]
            heading = f"{name.removesuffix('_us').replace('_', ' ')} p99 [µs]"
            yield heading, _Raw(f"{value:.0f}", value, ratio=True, less_is_better=True)


def _ended(safety: Mapping[str, Any]) -> str:
    fault = safety["fault"]["name"]
    return str(safety["state"]) if fault == "none" else str(fault).replace("_", " ")


def _share(value: float | None, grade: Grade, *, ratio: bool = True) -> _Raw:
    text = "–" if value is None else in_percent(value)
    return _Raw(text, value, grade, ratio, less_is_better=True)


def different_keys(runs: Sequence[Run]) -> list[tuple[str, list[str]]]:
    """Return the keys of the trials that are not the same in all runs, with each run's value.

    Effects that are hidden in the plant are in no trial.yaml, but in truth.json.
    """
    flat = [dict(_flat(run.trial)) | dict(_hidden(run)) for run in runs]
    keys = sorted({key for one in flat for key in one})
    rows = [(key, [one.get(key, "–") for one in flat]) for key in keys]
    return [(key, values) for key, values in rows if len(set(values)) > 1]


def _hidden(run: Run) -> Iterator[tuple[str, str]]:
    """Yield the keys of the effects that are hidden in a run's plant, in the rig's units."""
    truth = read_truth(run.folder) or {}
    if hidden := truth.get("undeclared"):
        yield from _flat(hidden, "plant.undeclared")


def _flat(content: Any, path: str = "") -> Iterator[tuple[str, str]]:
    if isinstance(content, Mapping) and content:
        for key, value in content.items():
            yield from _flat(value, f"{path}.{key}" if path else str(key))
    elif isinstance(content, list) and any(isinstance(one, Mapping) for one in content):
        for place, one in enumerate(content):
            yield from _flat(one, f"{path}[{place}]")
    else:
        yield path, f"{content:g}" if isinstance(content, float) else str(content)


def overlaid(runs: Sequence[Run]) -> list[Chart]:
    """Return the charts of several runs with a curve for each: force, residual and parameters."""
    whole = (0.0, max(span(run)[1] for run in runs))
    shortest = min(runs, key=lambda run: span(run)[1])  # every run has curves in its window
    looks: list[dict[str, Any]] = [
        {"label": name, "colour": COLOURS[i % len(COLOURS)], "style": DASHES[i // len(COLOURS) % 4]}
        for i, name in enumerate(letters(len(runs)))
    ]
    times = [seconds(run, run.slave) for run in runs]
    unit = runs[0].units.force
    forces = _curves(times, [run.slave["filtered_force"] for run in runs], looks)
    left = _curves(times, [run.residual for run in runs], looks)
    limits = _widest([robust_limits(curve.x, curve.y)[0] for curve in left])
    panels = (
        Panel(ylabel=f"force at the slave [{unit}]", curves=forces, height=2.0),
        Panel(ylabel=f"residual [{unit}]", curves=left, limits=limits, zero=True),
    )
    force = Chart(
        name="forces",
        label="force and residual of every run",
        xlabel="time [s]",
        panels=panels,
        limits=whole,
        window=window(shortest),
        linked="near",
        notes=("The force is filtered as the estimators see it.",),
    )
    return [force, *_parameters(runs, looks, whole)]


def _curves(
    times: Sequence[Array], columns: Sequence[Array], looks: Sequence[Mapping[str, Any]]
) -> tuple[Curve, ...]:
    """Return a curve for each run, named by its letter."""
    rows = zip(times, columns, looks, strict=True)
    return tuple(Curve(x=t, y=y, width=1.4, **look) for t, y, look in rows)


def _widest(found: Sequence[tuple[float, float] | None]) -> tuple[float, float] | None:
    known = [one for one in found if one is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None


def _parameters(
    runs: Sequence[Run], looks: Sequence[Mapping[str, Any]], whole: tuple[float, float]
) -> Iterator[Chart]:
    """Give a chart of the selected estimator's parameters, for each model that was selected."""
    chosen = [run.summary["selected"] or {} for run in runs]
    for model in dict.fromkeys(one["model"] for one in chosen if one):
        curves: dict[str, list[Curve]] = {}
        for run, one, look in zip(runs, chosen, looks, strict=True):
            topic = f"/estimates/{model}/{one.get('regression')}/{one.get('solver')}"
            columns = run.topics.get(topic, {}) if one.get("model") == model else {}
            for name in (n for n in columns if f"{n}_std" in columns and n != "offset"):
                known = np.where(np.isin(columns["status"], UNKNOWN), np.nan, columns[name])
                curve = Curve(x=seconds(run, columns), y=known, width=1.4, **look)
                curves.setdefault(name, []).append(curve)
        units = runs[0].units.position, runs[0].units.force
        panels = [
            Panel(
                ylabel=f"{name} [{parameter_unit(model, name, *units)}]",
                curves=tuple(found),
                limits=settled_limits([curve.y for curve in found]),
            )
            for name, found in curves.items()
        ]
        if panels:
            yield Chart(
                name=f"parameters-{model}",
                label=f"parameters of {model_name(model)}",
                xlabel="time [s]",
                panels=tuple(panels),
                limits=whole,
                linked="whole",
            )
