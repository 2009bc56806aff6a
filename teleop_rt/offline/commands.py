"""The commands that work on recordings: every file is done, a bad one is told and skipped."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

from teleop_rt.contact.effects.user import library
from teleop_rt.diagnosis.base import MODELS, TERMS
from teleop_rt.diagnosis.diagnose import diagnose as diagnose_recording
from teleop_rt.diagnosis.recording import refuse_other_units
from teleop_rt.errors import RecordingError
from teleop_rt.offline.load import Table, load_any
from teleop_rt.offline.replay import Choice, write_trace
from teleop_rt.offline.replay import replay as replay_file
from teleop_rt.offline.write import write_diagnosis
from teleop_rt.realtime.export import export as export_topic
from teleop_rt.realtime.export import recover as recover_recording
from teleop_rt.trial.folder import RECORDING, plain_json, recording_of
from teleop_rt.trial.table import estimator_lines
from teleop_rt.view.style import parameter

BAD_INPUT = 2
BASE_HELP = f"a model: {', '.join(MODELS)}; or terms by commas: {', '.join(TERMS)}"
_BAD = (RecordingError, ValueError, OSError)

Recordings = Annotated[list[Path], typer.Argument(help="MCAP, CSV, MAT, NPZ; run folders")]
Surface = Annotated[str, typer.Option(help="auto, or the surface's position [m or rad]")]
Columns = Annotated[
    list[str] | None, typer.Option("--columns", metavar="ROLE=NAME", help="which column is what")
]
UnitsOption = Annotated[
    list[str] | None, typer.Option("--units", metavar="ROLE=UNIT", help="unit of a column")
]
Rate = Annotated[float | None, typer.Option(help="samples per second, where there is no time")]
Json = Annotated[bool, typer.Option("--json", help="one JSON object per recording and line")]


def replay(
    recordings: Recordings,
    models: Annotated[str | None, typer.Option(help="model ids, by commas")] = None,
    regressions: Annotated[str | None, typer.Option(help="direct, algebraic")] = None,
    solvers: Annotated[str | None, typer.Option(help="solver ids, by commas")] = None,
    surface: Surface = "auto",
    columns: Columns = None,
    units: UnitsOption = None,
    rate: Rate = None,
    trace: Annotated[Path | None, typer.Option(help="NPZ file for parameters over time")] = None,
    as_json: Json = False,
) -> None:
    """Run the estimators over recordings."""
    table = table_of(columns, units, rate)
    choice = Choice(_names(models), _names(regressions), _names(solvers), _surface(surface))
    own = _own_names(recordings)

    def one(path: Path) -> dict[str, Any]:
        answer, over_time = replay_file(path, choice, table)
        if trace is not None:
            several = len(recordings) > 1
            beside = trace.with_stem(f"{trace.stem}-{own[path]}") if several else trace
            write_trace(beside, over_time)
        return answer

    _each(recordings, one, _print_replay, as_json=as_json)


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
        Path | None, typer.Option(help="folder for page, model and proposed trial")
    ] = None,
    as_json: Json = False,
) -> None:
    """Find what a model leaves unexplained, name the effect, and tell the error with it."""
    table = table_of(columns, units, rate)
    known = library(effects)
    held_out = load_any(recording_of(test), table) if test is not None else None
    own = _own_names(recordings)
    if out is not None and out.exists() and not out.is_dir():
        raise RecordingError(f"--out {out}: is a file: name a folder, which is made if need be")

    def one(path: Path) -> dict[str, Any]:
        recording = load_any(path, table)
        if held_out is not None:
            refuse_other_units(held_out, recording)
        found = diagnose_recording(
            recording, base, test=held_out, effects=known, surface=_surface(surface)
        )
        if test is not None and test.samefile(path):
            found.answer["notes"].append("nothing is held out: --test is the recording itself")
        if out is not None:
            write_diagnosis(
                found, recording, path, out if len(recordings) == 1 else out / own[path]
            )
        return {**found.answer, "recording": str(path)}

    _each(recordings, one, _print_diagnosis, as_json=as_json)


def recover(
    recording: Annotated[Path, typer.Argument(help="a recording that was cut off, or its folder")],
    out: Annotated[Path | None, typer.Option(help="by default NAME.recovered.mcap")] = None,
) -> None:
    """Make a recording whole that was cut off by a crash; the original stays as it is."""
    recording = recording_of(recording)
    whole = out or recording.with_suffix(".recovered.mcap")
    print(f"{recover_recording(recording, whole)} messages saved in {whole}")


def export(
    recording: Annotated[Path, typer.Argument(help="an MCAP recording, or a run folder")],
    out: Annotated[Path, typer.Argument(help="a .csv, .npz or .mat file")],
    topic: Annotated[str, typer.Option(help="which channel")] = "/slave",
) -> None:
    """Write one channel of a recording as a table."""
    print(f"{export_topic(recording_of(recording), out, topic)} rows of {topic} in {out}")


def _each(
    recordings: Sequence[Path],
    one: Callable[[Path], dict[str, Any]],
    show: Callable[[Console, dict[str, Any]], None],
    *,
    as_json: bool,
) -> None:
    """Do each file; a bad one is told and the others still done, exit code 2 at the end."""
    bad = False
    console = Console()
    for path in recordings:
        try:
            answer = one(recording_of(path))
        except _BAD as error:
            bad = True
            answer = {"recording": str(path), "problem": str(error)}
            print(error, file=sys.stderr)
            if not as_json:
                continue
        if as_json:
            print(json.dumps(plain_json(answer)))
        else:
            show(console, answer)
    if bad:
        raise typer.Exit(BAD_INPUT)


def _print_replay(console: Console, answer: dict[str, Any]) -> None:
    told = f"[bold]{answer['recording']}[/bold]: {answer['samples']} samples"
    console.print(told, soft_wrap=True)
    for line in estimator_lines(answer):
        console.print(line, highlight=False, soft_wrap=True)


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
    if answer["verdict"] == "class":
        sets = "; or ".join(" + ".join(names) for names in answer["class"])
        console.print(f"  one of: {sets}", highlight=False, soft_wrap=True)


def _print_diagnosis(console: Console, answer: dict[str, Any]) -> None:
    error = answer["error"]
    verdict = answer["verdict"].replace("_", " ")
    console.print(f"[bold]{answer['recording']}[/bold]: {verdict}", soft_wrap=True)
    base = answer["base"]
    values = ", ".join(parameter(name, value) for name, value in base["parameters"].items())
    console.print(f"  {base['model']} (base): {values}", highlight=False, soft_wrap=True)
    print_effects(console, answer)
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


def _own_names(recordings: Sequence[Path]) -> dict[Path, str]:
    """Return what to call what is written of each recording: its name, or that of its run's folder.

    No two have the same, or the second would overwrite what was written of the first.
    """
    names: dict[Path, str] = {}
    for given in recordings:
        path = given / RECORDING if given.is_dir() else given
        stem = path.resolve().parent.name if path.name == RECORDING else path.stem
        taken = {name for other, name in names.items() if other != path}
        numbered = (f"{stem}-{number}" for number in count(2))
        names[path] = next(name for name in chain([stem], numbered) if name not in taken)
    return names
