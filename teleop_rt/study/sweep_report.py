"""Tables, figures and pages of the studies of noise, time, excitation and approach."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

from teleop_rt.batch.workers import Result
from teleop_rt.study.page import figure, flat, table, write_csv, write_page
from teleop_rt.view.style import method_name, model_name, number

Row = dict[str, Any]


class StudyPage(NamedTuple):
    """The page of a study: title, answer in one sentence, rows of its table, caption of both."""

    title: str
    headline: str
    rows: list[Row]
    caption: str


def rows_of(results: Sequence[Result]) -> list[Row]:
    """Return a row for each method of each case, or for each case that has no methods."""
    rows: list[Row] = []
    for result in results:
        own = {key: value for key, value in result.items() if key != "methods"}
        rows += [own | flat(one) for one in result.get("methods", [{}])]
    return rows


def grouped(rows: Iterable[Row], keys: Sequence[str], value: str, size: bool) -> list[Row]:
    """Return the median of `value` (of its size if asked) and how many have one, by `keys`."""
    groups: dict[tuple[Any, ...], list[float | None]] = {}
    for row in rows:
        groups.setdefault(tuple(row[key] for key in keys), []).append(row.get(value))
    medians: list[Row] = []
    for key, values in groups.items():
        known = [abs(one) if size else one for one in values if one is not None]
        medians.append(
            dict(zip(keys, key, strict=True))
            | {value: median(known) if known else None, "found": f"{len(known)} of {len(values)}"}
        )
    return medians


def write_study(folder: Path, study: str, results: Sequence[Result]) -> dict[str, Any]:
    """Write STUDY.csv with every row, figures where they can be drawn, and STUDY.html.

    Returns the summary: medians over the seeds, JSON-ready.
    """
    rows = rows_of(results)
    write_csv(folder / f"{study}.csv", rows)
    title, headline, summary, caption = SUMMARIES[study](rows)
    parts = ["<h2>Figure</h2>"]
    if importlib.util.find_spec("matplotlib") is not None:
        from teleop_rt.study import sweep_figures  # noqa: PLC0415 - an extra may be absent

        sweep_figures.draw(folder, study, summary)
        parts.append(figure(study.replace("-", "_"), caption))
    else:
        parts = [f"<p>{caption}</p>"]
    parts += ["<h2>Every case</h2>", table(summary)]
    write_page(folder / f"{study}.html", title, parts, headline)
    return {"cases": len(results), "summary": summary}


def _noise(rows: Sequence[Row]) -> StudyPage:
    keys = ("model", "regression", "solver", "noise_N", "resolution_m", "lag_ms")
    summary = grouped(rows, keys, "error_b", size=True)
    for row, other in zip(summary, grouped(rows, keys, "error_k", size=True), strict=True):
        row["error_k"] = other["error_k"]
    lags = sorted({row["lag_ms"] for row in summary})
    errors = [
        f"{model_name(model)} "
        + ", ".join(f"{_middle(summary, model, lag)} at {number(lag)} ms" for lag in lags)
        for model in dict.fromkeys(row["model"] for row in summary)
    ]
    return StudyPage(
        "Estimators under noise",
        f"Median relative error of b by the lag of the force: {'; '.join(errors)}.",
        summary,
        "Relative error of damping and stiffness, the median over the seeds, and in how many of "
        "them the row was estimated.",
    )


def _middle(summary: Sequence[Row], model: str, lag_ms: float) -> str:
    """Return the median error of b at a lag, over all methods, noises and resolutions."""
    places = [row for row in summary if (row["model"], row["lag_ms"]) == (model, lag_ms)]
    known = [row["error_b"] for row in places if row["error_b"] is not None]
    return f"{median(known):.2g}" if known else "–"


def _time_varying(rows: Sequence[Row]) -> StudyPage:
    keys = ("regression", "solver", "forgetting_factor", "ramp_s", "frequency_hz")
    summary = grouped(rows, keys, "delay_s", size=False)
    for row, other in zip(summary, grouped(rows, keys, "error_after", size=True), strict=True):
        row["error_after"] = other["error_after"]
    followed = [row for row in summary if row["delay_s"] is not None]
    headline = f"The change is followed in {len(followed)} of {len(summary)} cases"
    if followed:
        best = min(followed, key=lambda row: (row["delay_s"], abs(row["error_after"] or 0.0)))
        method = method_name(best["regression"], best["solver"])
        headline += f", soonest by {method}: after {number(best['delay_s'])} s"
    return StudyPage(
        "Parameters that vary",
        f"{headline}.",
        summary,
        "Tracking delay of the stiffness behind a step (ramp 0 s) or ramp from 1500 to 3600 N/m, "
        "the median over the seeds, and in how many the row follows at all.",
    )


def _excitation(rows: Sequence[Row]) -> StudyPage:
    shares = []
    for model in dict.fromkeys(row["model"] for row in rows):
        own = [row["excited"] for row in rows if row["model"] == model]
        shares.append(f"{model_name(model)} by {sum(own)} of {len(own)} motions")
    return StudyPage(
        "What one sinusoid excites",
        f"Excited: {', '.join(shares)}.",
        list(rows),
        "Condition number of the scaled normal matrix; a model is excited below 1e8.",
    )


def _approach(rows: Sequence[Row]) -> StudyPage:
    parts = []
    for leash, name in ((True, "with the leash"), (False, "without")):
        own = [row for row in rows if row["leash"] is leash]
        felt = [row for row in own if row["felt_s"] is not None]
        lead = number(max((row["lead_mm"] for row in own), default=0.0))
        parts.append(f"{name} {len(felt)} of {len(own)}, with a lead of up to {lead} mm")
    return StudyPage(
        "Before the first touch",
        f"Approaches that end at a wall that is felt: {'; '.join(parts)}.",
        list(rows),
        "Longest way by which the hand leads the slave before the wall is felt; crossed where the "
        "wall is never felt.",
    )


SUMMARIES: Mapping[str, Callable[[Sequence[Row]], StudyPage]] = {
    "noise": _noise,
    "time-varying": _time_varying,
    "excitation": _excitation,
    "approach": _approach,
}
