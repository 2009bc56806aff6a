"""The runs of a folder as a list: date, trial, end, and results."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from teleop_rt.errors import RecordingError
from teleop_rt.metrics import in_percent
from teleop_rt.realtime.mcap_end import ends_whole
from teleop_rt.realtime.parts import parts
from teleop_rt.trial.folder import RECORDING, SUMMARY, began_at
from teleop_rt.trial.grades import GRADE_COLOURS, MARKS, Grade, grades, of_loop, of_safety, worst
from teleop_rt.trial.summary_file import read_summary
from teleop_rt.view.run_folder import read_trial
from teleop_rt.view.style import model_name, parameter

_PARTS = {"felt_force": "felt force", "phantom": "force in free air"}


@dataclass(frozen=True, slots=True)
class Listed:
    """One run; values that its summary lacks are None."""

    folder: str
    began_at: str | None
    trial: str | None
    grade: Grade
    ended: str
    model: str | None = None
    parameters: dict[str, dict[str, Any]] = field(default_factory=dict)
    felt_nrmse: float | None = None
    why: str = ""
    """The parts of the run to which the grade is due, empty where it is good or not known."""


def runs_of(folder: Path) -> list[Listed]:
    """Return the runs in a folder and right below it, the newest first. Raises RecordingError."""
    if not folder.is_dir():
        raise RecordingError(f"{folder}: no such folder: name one that holds runs")
    found = [_listed(place) for place in _run_folders(folder)]
    return sorted(found, key=lambda one: one.began_at or "", reverse=True)


def _run_folders(folder: Path) -> Iterator[Path]:
    for place in (folder, *sorted(folder.iterdir())):
        if place.is_dir() and ((place / SUMMARY).is_file() or (place / RECORDING).is_file()):
            yield place


def _listed(folder: Path) -> Listed:
    try:
        summary = read_summary(folder)
        if summary is None:
            return Listed(
                str(folder), began_at(folder), _named(folder), "attention", "cut off: no summary"
            )
        if "side" in summary:
            return _of_one_side(folder, summary)
        return _marked(_of_summary(folder, summary), folder)
    except (RecordingError, KeyError, TypeError):
        ended = "summary of another version, or damaged"
        return Listed(str(folder), began_at(folder), None, "unknown", ended)


def _named(folder: Path) -> str | None:
    """Return the name in trial.yaml, or None where it cannot be read."""
    try:
        return str(read_trial(folder)["name"])
    except RecordingError:
        return None


def _of_one_side(folder: Path, summary: dict[str, Any]) -> Listed:
    """Return the line of a side that was started alone; only a slave has a chain of safety."""
    ended = f"{summary['side']} alone"
    grade: Grade = "unknown"
    if "safety" in summary:
        fault = summary["safety"]["fault"]["name"]
        ended = f"{ended}: {summary['safety']['state'] if fault == 'none' else fault}"
        grade = of_safety(summary["safety"])
    return Listed(str(folder), began_at(folder), summary["trial"], grade, ended)


def _of_summary(folder: Path, summary: dict[str, Any]) -> Listed:
    fault = summary["safety"]["fault"]["name"]
    chosen, graded = summary["selected"] or {}, grades(summary)
    grade = worst(graded.values())
    return Listed(
        folder=str(folder),
        began_at=summary.get("began_at") or began_at(folder),
        trial=summary["trial"],
        grade=grade,
        why=_why(graded, grade, _parts(summary)),
        ended=str(summary["safety"]["state"]) if fault == "none" else str(fault),
        model=chosen.get("model"),
        parameters={
            name: {key: one[key] for key in ("value", "std", "unit")}
            for name, one in chosen.get("parameters", {}).items()
        },
        felt_nrmse=summary["master"]["nrmse"],
    )


def _marked(run: Listed, folder: Path) -> Listed:
    """Return the line, which says so where the recording lacks its end, as after a broken copy.

    The summary stays that of the whole run.
    """
    try:
        whole = all(_ends_whole(part) for part in parts(folder / RECORDING))
    except OSError:
        return run  # it cannot be read; each command on it says why
    if whole:
        return run
    why = ", ".join(filter(None, (run.why, "recording")))
    grade = worst([run.grade, "attention"])
    return replace(run, grade=grade, why=why, ended=f"{run.ended}; recording cut off")


def _ends_whole(part: Path) -> bool:
    with part.open("rb") as stream:
        return ends_whole(stream)


def _parts(summary: Mapping[str, Any]) -> dict[str, str]:
    """Return the words for the parts; a loop in time is no cause, where somebody ended the run."""
    in_time = of_loop(summary["missed_ticks"], summary["ticks"]) == "good"
    ended = {"loop": "interrupted"} if summary.get("interrupted") and in_time else {}
    return _PARTS | ended


def _why(graded: Mapping[str, Grade], grade: Grade, words: Mapping[str, str]) -> str:
    """Return the parts that have the run's own grade, where that is attention or bad."""
    if grade not in {"attention", "bad"}:
        return ""
    return ", ".join(words.get(part, part) for part, one in graded.items() if one == grade)


def print_runs(console: Console, runs: Iterable[Listed]) -> None:
    """Print runs as a table, a line each."""
    table = Table(box=None, pad_edge=False, header_style="dim")
    for heading in (
        "",
        "began",
        "why",
        "trial",
        "ended",
        "model",
        "parameters",
        "felt error",
        "folder",
    ):
        table.add_column(heading, overflow="fold")  # a cut name names nothing
    for run in runs:
        felt = "–" if run.felt_nrmse is None else in_percent(run.felt_nrmse)
        table.add_row(
            f"[{GRADE_COLOURS[run.grade]}]{MARKS[run.grade]}[/]",
            (run.began_at or "–")[:16].replace("T", " "),
            run.why or "–",
            run.trial or "–",
            run.ended.replace("_", " "),
            "–" if run.model is None else model_name(run.model),
            ", ".join(parameter(name, one) for name, one in run.parameters.items()) or "–",
            felt,
            run.folder,
        )
    console.print(table, soft_wrap=True, highlight=False)
