"""The page of a closed loop: the missing effect, and the errors before and after."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.diagnosis.answers.residuals import Residuals
from teleop_rt.errors import RecordingError
from teleop_rt.metrics import in_percent
from teleop_rt.outputs import write_whole
from teleop_rt.trial.folder import RECORDING
from teleop_rt.trial.grades import Grade, of_error
from teleop_rt.trial.summary_file import read_summary
from teleop_rt.view.charts import Chart, Curve, Panel, robust_limits
from teleop_rt.view.html import figures_of, render
from teleop_rt.view.residual_charts import residual_charts
from teleop_rt.view.run_folder import FeltOf, Run, load_run, read_recorded
from teleop_rt.view.run_times import seconds, span, window
from teleop_rt.view.style import BLUE, VERMILLION, Style, model_name, parameter

PAGE = "loop.html"
_RUNS = ("before", "after")
_LOOKS: tuple[tuple[str, str, Style], ...] = (
    ("without the effect", VERMILLION, "dashed"),
    ("with the effect", BLUE, "solid"),
)
_HARDLY_FELL = 0.9
"""Of the error before: an effect that leaves more does not describe the fresh data."""
_LINKS = (
    ("first/report.html", "the first run"),
    ("diagnosis/diagnosis.html", "its diagnosis"),
    ("experiment/report.html", "the motion that decides"),
    ("experiment-diagnosis/diagnosis.html", "the diagnosis of that"),
    ("before/report.html", "the fresh trial without the effect"),
    ("after/report.html", "the fresh trial with the effect"),
    ("model.yaml", "the extended model"),
    ("withdrawn.yaml", "the extended model, withdrawn"),
)
_ERRORS = (
    ("slave", "free_run", "Force predicted in free run"),
    ("slave", "on_line", "Force predicted on-line"),
    ("master", None, "Force felt at the hand"),
)


def write_loop_page(
    answer: Mapping[str, Any], folder: Path, felt_of: FeltOf, residuals: Residuals | None = None
) -> Path:
    """Write loop.html of an answer of `close-loop` into its folder, and return its path.

    `residuals` are those of recordings, where no trial was run: of the fresh one, if there is one.
    """
    charts = list(_charts(folder, felt_of))
    if residuals is not None:
        data = "fresh data" if answer["fresh"] else "the diagnosed data"
        charts += [
            replace(chart, label=f"{chart.label}, on {data}")
            for chart in residual_charts(residuals)[:2]
        ]
    grade, sentence = verdict(answer)
    page = render(
        "loop.html.j2",
        answer=answer,
        grade=grade,
        verdict=sentence,
        errors=list(_errors(answer)),
        effects=[_effect(one, answer) for one in answer["effects"]],
        base=model_name(answer["base"]["model"]),
        links=[(path, words) for path, words in _LINKS if (folder / path).is_file()],
        **figures_of(charts),
    )
    path = folder / PAGE
    write_whole(path, page)
    return path


def verdict(answer: Mapping[str, Any]) -> tuple[Grade, str]:
    """Return grade and sentence for the closed loop."""
    names = " and ".join(one["name"].replace("_", " ") for one in answer["effects"])
    if answer["withdrawn"]:
        return "attention", f"Found {names}, and withdrawn: {'; '.join(answer['withdrawn'])}."
    if answer["verdict"] == "no_missing_effect":
        return "good", "No missing effect was found: nothing was added."
    if answer["fresh"] is None:
        return "attention", str(answer.get("reason", "Nothing was added.")).capitalize() + "."
    if not names:
        return "attention", "A law was drafted from the unexplained force, and added."
    if not any(_fell(answer["fresh"], *where) for where in _ERRORS):
        return "attention", (
            f"The model lacked {names}: added, but most of the error on fresh data stays: something"
            " else acts there, or they are of another object."
        )
    return "good", f"The model lacked {names}: added, and the errors on fresh data fell."


def _fell(fresh: Mapping[str, Any], part: str, key: str | None, _: str) -> bool:
    """Return whether an error on fresh data fell by a tenth or more."""
    error = fresh[part] if key is None else fresh[part][key]
    before, after = error["before"], error["after"]
    return before is not None and after is not None and after <= _HARDLY_FELL * before


def _errors(answer: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Give the three errors on fresh data: title, change, and the grade of the error after."""
    for part, key, title in _ERRORS if answer["fresh"] else ():
        error = answer["fresh"][part] if key is None else answer["fresh"][part][key]
        yield {
            "title": title,
            "value": _change(error["before"], error["after"]),
            "grade": of_error(error["after"]),
            "reason": error.get("reason", ""),
        }


def _change(before: float | None, after: float | None) -> str:
    """Return an error before and after in words."""
    if before is None and after is None:
        return "not measured"
    return f"{_percent(before)} → {_percent(after)}"


def _percent(value: float | None) -> str:
    return "–" if value is None else in_percent(value)


def _effect(one: Mapping[str, Any], answer: Mapping[str, Any]) -> dict[str, Any]:
    """Return an effect in words: name, parameters, and who answers for it."""
    handled = (answer["fresh"] or {}).get("handled", ())
    where = [f"{h['where']}: {h['how']}" for h in handled if h["name"] == one["name"]]
    values = one["parameters"].items()
    return {
        "name": one["name"].replace("_", " "),
        "parameters": [parameter(name.replace("_", " "), value) for name, value in values],
        "where": where[0] if where else f"belongs to the {one['belongs_to']}",
    }


def _charts(folder: Path, felt_of: FeltOf) -> Iterator[Chart]:
    """Yield the residual force of both fresh runs, at the slave and under the hand."""
    places = [folder / name for name in _RUNS]
    if not all((place / RECORDING).is_file() for place in places):
        return
    runs = [_run(place, felt_of) for place in places]
    slave = [(seconds(run, run.slave), run.residual) for run in runs]
    yield _chart(runs, "residual", "the part of the slave's force that the model leaves", slave)
    felt = [run.felt for run in runs]
    if all(one is not None for one in felt):
        hand = [
            ((one.stamp_ns - run.start_ns) * 1e-9, one.rendered - one.true)
            for run, one in zip(runs, felt, strict=True)
            if one is not None
        ]
        yield _chart(runs, "felt-error", "felt force minus that of the true environment", hand)


def _run(folder: Path, felt_of: FeltOf) -> Run:
    summary = read_summary(folder)
    if summary is None:
        raise RecordingError(f"{folder}: has no summary, because its run was cut off: run it again")
    return load_run(folder, summary, read_recorded(folder), felt_of)


def _chart(runs: Sequence[Run], name: str, label: str, rows: Sequence[tuple[Any, Any]]) -> Chart:
    curves = tuple(
        Curve(label=key, x=t, y=y, colour=colour, style=style, width=1.3)
        for (t, y), (key, colour, style) in zip(rows, _LOOKS, strict=True)
    )
    limits = [robust_limits(curve.x, curve.y)[0] or (0.0, 0.0) for curve in curves]
    most = max(float(np.max(np.abs(pair))) for pair in limits) or None
    return Chart(
        name=name,
        label=label,
        xlabel="time [s]",
        panels=(
            Panel(
                ylabel=f"force [{runs[0].units.force}]",
                curves=curves,
                limits=None if most is None else (-most, most),
                zero=True,
            ),
        ),
        limits=span(runs[0]),
        window=window(runs[0]),
        linked="near",
    )
