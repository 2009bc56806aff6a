"""The commands that work on recordings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from teleop_rt.batch.bar import bar
from teleop_rt.batch.workers import Workers
from teleop_rt.diagnosis.base import MODELS, TERMS
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.report import best_first
from teleop_rt.estimation.rows import REGRESSIONS, SOLVERS
from teleop_rt.offline.find import names_one
from teleop_rt.offline.many import each
from teleop_rt.offline.table import Table
from teleop_rt.realtime.export import export as export_topic
from teleop_rt.realtime.export import is_whole
from teleop_rt.realtime.export import recover as recover_recording
from teleop_rt.trial.folder import recording_of
from teleop_rt.trial.table import but_for, estimator_lines
from teleop_rt.view.style import parameter

_BEST_FEW = 5
"""Estimators that a replay prints: what fits a screen with their parameters."""
BASE_HELP = f"a model: {', '.join(MODELS)}; or terms by commas: {', '.join(TERMS)}"

Recordings = Annotated[
    list[Path], typer.Argument(help="MCAP, CSV, MAT, NPZ; run folders; folders and globs of these")
]
Surface = Annotated[str, typer.Option(help="auto, or the surface's position [m or rad]")]
Columns = Annotated[
    list[str] | None, typer.Option("--columns", metavar="ROLE=NAME", help="which column is what")
]
UnitsOption = Annotated[
    list[str] | None, typer.Option("--units", metavar="ROLE=UNIT", help="unit of a column")
]
Rate = Annotated[float | None, typer.Option(help="samples per second, where there is no time")]
Json = Annotated[bool, typer.Option("--json", help="one JSON object per recording and line")]
Jobs = Annotated[int, typer.Option(min=0, help="cores to use; 0 takes all that are worth it")]
Scheduler = Annotated[str | None, typer.Option(help="a Dask scheduler, tcp://HOST:PORT")]


def _some_of(ids: Iterable[str]) -> str:
    return f"by commas, of {', '.join(ids)}; by default those of the run, or all"


def replay(
    recordings: Recordings,
    models: Annotated[str | None, typer.Option(help=_some_of(MODELS))] = None,
    regressions: Annotated[str | None, typer.Option(help=_some_of(REGRESSIONS))] = None,
    solvers: Annotated[str | None, typer.Option(help=_some_of(SOLVERS))] = None,
    surface: Surface = "auto",
    columns: Columns = None,
    units: UnitsOption = None,
    rate: Rate = None,
    trace: Annotated[Path | None, typer.Option(help="NPZ file for parameters over time")] = None,
    out: Annotated[Path | None, typer.Option(help="folder that keeps the answers of many")] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    every: Annotated[
        bool, typer.Option("--all", help="print all estimators, not the best")
    ] = False,
    as_json: Json = False,
) -> None:
    """Run the estimators over recordings."""
    with bar("loading the estimators", counts=False):
        from teleop_rt.offline.replay import Choice  # noqa: PLC0415 - compiles for seconds
        from teleop_rt.offline.work import Replaying  # noqa: PLC0415 - as above

    table = table_of(columns, units, rate)
    choice = Choice(_names(models), _names(regressions), _names(solvers), _surface(surface))
    work = Replaying(choice, table, trace, several=not names_one(recordings))
    workers = Workers(jobs, scheduler)
    each(work, recordings, workers, out, partial(_print_replay, every=every), as_json=as_json)


def diagnose(
    recordings: Recordings,
    base: Annotated[str, typer.Option(help=BASE_HELP)] = "kelvin-voigt",
    test: Annotated[Path | None, typer.Option(help="recording on which error is told")] = None,
    surface: Surface = "auto",
    effects: Annotated[Path | None, typer.Option(help="Python file with effects of yours")] = None,
    columns: Columns = None,
    units: UnitsOption = None,
    rate: Rate = None,
    out: Annotated[
        Path | None,
        typer.Option(help="folder for page, model and proposed trial; of many, one below it each"),
    ] = None,
    jobs: Jobs = 0,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Find what a model leaves unexplained, name the effect, and tell the error with it."""
    with bar("loading the effects", counts=False):
        from teleop_rt.offline.work import Diagnosing  # noqa: PLC0415 - compiles for seconds

    table = table_of(columns, units, rate)
    several = not names_one(recordings)
    work = Diagnosing(base, _surface(surface), table, test, effects, out, several=several)
    workers = Workers(jobs, scheduler)
    each(work, recordings, workers, out, _print_diagnosis, as_json=as_json)


def recover(
    recording: Annotated[Path, typer.Argument(help="a recording that was cut off, or its folder")],
    out: Annotated[Path | None, typer.Option(help="by default NAME.recovered.mcap")] = None,
) -> None:
    """Make a recording whole that was cut off by a crash; the original stays as it is."""
    recording = recording_of(recording)
    if (messages := is_whole(recording)) is not None:
        print(f"{recording} is whole, with {messages} messages: nothing to recover")
        return
    whole = out or recording.with_suffix(".recovered.mcap")
    print(f"{recover_recording(recording, whole)} messages saved in {whole}")


def export(
    recording: Annotated[Path, typer.Argument(help="an MCAP recording, or a run folder")],
    out: Annotated[Path, typer.Argument(help="a .csv, .npz or .mat file")],
    topic: Annotated[str, typer.Option(help="which channel")] = "/slave",
) -> None:
    """Write one channel of a recording as a table."""
    print(f"{export_topic(recording_of(recording), out, topic)} rows of {topic} in {out}")


def _print_replay(console: Console, answer: dict[str, Any], *, every: bool) -> None:
    """Print the estimators, best first; the best few of many unless `every` one is wanted."""
    told = f"[bold]{answer['recording']}[/bold]: {answer['samples']} samples"
    console.print(told, soft_wrap=True)
    rows = best_first(answer["estimators"], answer["selected"])
    shown = rows if every else rows[:_BEST_FEW]
    for line in estimator_lines(answer | {"estimators": shown}):
        console.print(line, highlight=False, soft_wrap=True)
    if answer["selected"] is None:
        console.print("  none is selected: no estimator is identified", highlight=False)
    if len(rows) > len(shown):
        console.print(f"  and {len(rows) - len(shown)} more: --all prints them", highlight=False)


def print_effects(console: Console, answer: Mapping[str, Any]) -> None:
    """Print the effects that a diagnosis found, with their parameters, and the class."""
    for effect in answer["effects"]:
        values = ", ".join(
            parameter(name, value)
            for name, value in effect["parameters"].items()
            if value["value"] is not None
        )
        told = f"  {effect['name']} ({effect['belongs_to']}): {values}"
        console.print(told, highlight=False, soft_wrap=True)
    if len(answer["class"]) > 1:
        sets = "; or ".join(" + ".join(names) for names in answer["class"])
        console.print(f"  one of: {sets}", highlight=False, soft_wrap=True)


def print_draft(console: Console, draft: Mapping[str, Any] | None) -> None:
    """Print where a drafted law was written, and the errors with it."""
    if draft is None:
        return
    error = draft["error"]
    before, after = _share(error["before"]), _share(error["after"])
    console.print(
        f"  drafted law: {'; '.join(draft['terms'])}: NRMSE on {error['on']}: before {before},"
        f" after {after}; {draft['file']} is ready for --effects",
        highlight=False,
        soft_wrap=True,
    )


def _print_diagnosis(console: Console, answer: dict[str, Any]) -> None:
    error = answer["error"]
    verdict = answer["verdict"].replace("_", " ")
    if answer["verdict"] in {"partial", "unexplained"}:
        verdict += but_for(answer["notes"])
    console.print(f"[bold]{answer['recording']}[/bold]: {verdict}", soft_wrap=True)
    base = answer["base"]
    values = ", ".join(parameter(name, value) for name, value in base["parameters"].items())
    console.print(f"  {base['model']} (base): {values}", highlight=False, soft_wrap=True)
    print_effects(console, answer)
    if answer["predictor"] and set(answer["predictor"]) != {e["name"] for e in answer["effects"]}:
        told = f"  predicts best with: {' + '.join(answer['predictor'])}"
        console.print(told, highlight=False, soft_wrap=True)
    before, after, floor = (_share(error[key]) for key in ("before", "after", "noise_floor"))
    console.print(
        f"  NRMSE on {error['on']}: before {before}, after {after}, noise floor {floor}",
        highlight=False,
        soft_wrap=True,
    )
    if (nearest := answer["nearest"]) is not None:
        console.print(
            f"  nearest: {' + '.join(nearest['effects'])}, of the family {nearest['family']},"
            f" explains {100.0 * nearest['share']:.0f} % of what the base leaves: NRMSE before"
            f" {_share(nearest['before'])}, after {_share(nearest['after'])}",
            highlight=False,
            soft_wrap=True,
        )
    if answer["dependence"] is not None:
        parts = sorted(answer["dependence"].items(), key=lambda item: -item[1])
        told = ", ".join(f"{group} {100.0 * share:.0f} %" for group, share in parts if share > 0.0)
        console.print(f"  what is left depends on: {told}", highlight=False, soft_wrap=True)
    print_draft(console, answer["draft"])
    seen = [one for one in answer["detectable"] if one["size"] is not None]
    if answer["verdict"] == "no_missing_effect" and seen:
        told = "; ".join(
            f"{one['name']} above {_share(one['size'])} {one['unit']}".removesuffix(" 1")
            for one in seen
        )
        console.print(f"  would have been seen: {told}", highlight=False, soft_wrap=True)
    if (experiment := answer["experiment"]) is not None:
        where = "" if experiment["trial"] is None else f"; run {experiment['trial']}"
        console.print(f"  to decide: {experiment['why']}{where}", highlight=False, soft_wrap=True)
    if (gaps := answer["gaps"])["samples"]:
        told = f"  {gaps['samples']} samples missing in {gaps['count']} gaps"
        console.print(told, highlight=False)
    for note in answer["notes"]:
        console.print(f"  note: {note}", highlight=False, soft_wrap=True)
    for name, entry in answer.get("instruments", {"parameters": {}})["parameters"].items():
        console.print(
            f"  {name} by instruments from the reference: {_share(entry['value'])} {entry['unit']},"
            f" by least squares {_share(entry['least_squares'])}",
            highlight=False,
            soft_wrap=True,
        )


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"


def table_of(columns: list[str] | None, units: list[str] | None, rate: float | None) -> Table:
    """Return the layout of a foreign file that the options tell. Raises RecordingError."""
    return Table(_pairs(columns, "--columns"), _pairs(units, "--units"), rate)


def _pairs(given: list[str] | None, option: str) -> dict[str, str]:
    pairs = {}
    for text in (part for item in given or () for part in item.split(",")):
        role, separator, name = text.partition("=")
        if not separator:
            raise RecordingError(f"{option} {text}: write ROLE=NAME, for example position=xs_rad")
        pairs[role] = name
    return pairs


def _names(text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",")]


def _surface(text: str) -> float | None:
    if text == "auto":
        return None
    try:
        return float(text)
    except ValueError:
        raise RecordingError(f"--surface {text}: write auto, or a position") from None
