"""The command that closes the loop, for a trial that is run or for measured files."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.console import Console

from teleop_rt.config import TrialConfig
from teleop_rt.contact.effects.user import library
from teleop_rt.errors import RecordingError
from teleop_rt.offline.closing import close_loop
from teleop_rt.offline.closing_files import Files, close_recordings
from teleop_rt.offline.commands import (
    BASE_HELP,
    Columns,
    Rate,
    UnitsOption,
    print_draft,
    print_effects,
    table_of,
)
from teleop_rt.shipped import trial_file as shipped_or_file
from teleop_rt.trial.folder import make_folder, new_folder, plain_json, recording_of, write_json
from teleop_rt.view.quantities import SMALL, small

Clock = Literal["real", "simulated"]
LoadTrial = Callable[[Path, list[str]], TrialConfig]
RunFolder = Callable[[Path, list[str], Clock, Path], Mapping[str, Any]]
"""(trial file, overrides, clock, new folder) -> summary."""


def close_loop_command(load: LoadTrial, run: RunFolder) -> Callable[..., None]:
    """Return the command, given how a trial is loaded and run: only `cli.py` knows."""

    def close_loop_(
        trial_file: Annotated[
            Path | None,
            typer.Argument(
                metavar="TRIAL",
                parser=shipped_or_file,
                help="the trial: a YAML file, or the name of one that ships",
            ),
        ] = None,
        recording: Annotated[Path | None, typer.Option(help="measured file, not a trial")] = None,
        test: Annotated[Path | None, typer.Option(help="measured file to tell error on")] = None,
        base: Annotated[
            str | None, typer.Option(help=f"by default the trial's first model; {BASE_HELP}")
        ] = None,
        clock: Annotated[Clock, typer.Option(help="real or simulated time")] = "real",
        effects: Annotated[Path | None, typer.Option(help="Python file, effects of yours")] = None,
        columns: Columns = None,
        units: UnitsOption = None,
        rate: Rate = None,
        out: Annotated[Path | None, typer.Option(help="folder to write; must be empty")] = None,
        overrides: Annotated[
            list[str] | None, typer.Option("--set", metavar="KEY.PATH=VALUE")
        ] = None,
        as_json: Annotated[bool, typer.Option("--json", help="print the answer as JSON")] = False,
    ) -> None:
        """Run a trial, find what its model lacks, add it, and tell the error on a fresh trial."""
        begun = time.perf_counter()
        if trial_file is not None and recording is None and test is None:
            changes = list(overrides or [])
            changes += [f"effects_file={effects.resolve()}"] if effects is not None else []
            trial = load(trial_file, changes)
            base = base or trial.estimation.models[0]
            load(trial_file, [*changes, f"estimation.models=[{base}]"])  # before anything moves
            folder = make_folder(out, f"{trial.name}-loop")
            own = Path(trial.effects_file) if trial.effects_file else None
            answer = close_loop(
                trial,
                base,
                lambda more, into: run(trial_file, [*changes, *more], clock, into),
                library(own),
                folder,
            )
        elif recording is not None and test is not None and trial_file is None:
            recording, test = recording_of(recording), recording_of(test)
            table = table_of(columns, units, rate)
            with new_folder(out, f"{recording.stem}-loop") as folder:
                files = Files(recording, test, table, effects)
                answer = close_recordings(files, base or "kelvin-voigt", folder)
        else:
            raise RecordingError("give a trial, or both --recording and --test")
        answer["seconds"] = round(time.perf_counter() - begun, 1)
        write_json(folder / "loop.json", answer)
        if as_json:
            print(json.dumps(plain_json(answer)))
        else:
            _show(Console(), answer, folder)

    return close_loop_


def _show(console: Console, answer: Mapping[str, Any], folder: Path) -> None:
    console.print(f"[bold]{answer.get('trial') or answer['recording']}[/bold]:"
                  f" {answer['verdict'].replace('_', ' ')}")  # fmt: skip
    if answer.get("reason"):
        console.print(f"  {answer['reason']}", highlight=False)
    print_effects(console, answer)
    print_draft(console, answer["draft"])
    if (shift := answer.get("surface_shift")) is not None:
        where = "deep" if shift["value"] > 0.0 else "shallow"
        size = f"{SMALL * abs(shift['value']):.2g} {small(shift['unit'])}"
        told = f"  the run took its surface {size} too {where}: it is found anew in each run"
        console.print(told, highlight=False)
    if (fresh := answer["fresh"]) is not None:
        was = "was, until it was withdrawn," if answer.get("withdrawn") else "is"
        for one in fresh["handled"]:
            console.print(f"  {one['name']} {was} {one['where']}: {one['how']}", highlight=False)
        for words, error in (
            ("slave, force predicted in free run", fresh["slave"]["free_run"]),
            ("slave, force predicted on-line", fresh["slave"]["on_line"]),
            ("master, force felt", fresh["master"]),
        ):
            before, after = (_number(error[key]) for key in ("before", "after"))
            if error["before"] is not None or error["after"] is not None:
                console.print(f"  {words}: NRMSE before {before}, after {after}", highlight=False)
            elif error.get("reason"):
                console.print(f"  {words}: {error['reason']}", highlight=False)
    console.print(f"files in {folder}", highlight=False)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
