"""The command `close-loop`: for a trial that is run, or for measured files."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

import typer
from rich.console import Console
from rich.markup import escape

from teleop_rt.batch.bar import bar
from teleop_rt.config.trial import TrialConfig
from teleop_rt.contact.effects.user import library
from teleop_rt.diagnosis.answers.residuals import Residuals
from teleop_rt.errors import FAULT, RecordingError
from teleop_rt.interrupts import interruptions
from teleop_rt.offline.closing import close_loop
from teleop_rt.offline.closing_files import Files, close_recordings
from teleop_rt.offline.commands import print_draft, print_effects
from teleop_rt.offline.find import refuse_itself
from teleop_rt.offline.phases import phases_of_command
from teleop_rt.offline.table import Table
from teleop_rt.offline.write import Keep, report_missing_page
from teleop_rt.outputs import DISK_FULL
from teleop_rt.trial.folder import (
    folder_if_filled,
    new_folder,
    plain_json,
    recording_of,
    write_json,
)
from teleop_rt.view.console import output
from teleop_rt.view.quantities import SMALL, small
from teleop_rt.view.run_folder import FeltOf
from teleop_rt.view.style import number

Clock = Literal["real", "simulated"]
LoadTrial = Callable[[Path, list[str]], TrialConfig]
RunFolder = Callable[[Path, list[str], Clock, Path], Mapping[str, Any]]
"""(trial file, overrides, clock, new folder) -> summary."""


_PHASES = {
    "first": "running the trial",
    "experiment": "running the motion that decides",
    "before": "fresh trial without the effect",
    "after": "fresh trial with the effect",
}
"""The run in each folder."""


@dataclass(frozen=True, slots=True)
class Asked:
    """The input of `close-loop`: a trial with overrides, or a recording and a test recording."""

    trial_file: Path | None
    recording: Path | None
    test: Path | None
    base: str | None
    clock: Clock
    effects: Path | None
    table: Table
    out: Path | None
    overrides: list[str]


def close_and_print(
    asked: Asked, load: LoadTrial, run: RunFolder, felt_of: FeltOf, *, as_json: bool
) -> None:
    """Close the loop, write loop.json and its page, and print the answer.

    Only the command line knows how a trial is loaded and run, and its felt force. After the fault
    of a later run, and on a full disk, it prints the answer so far and leaves. Raises
    RecordingError.
    """
    so_far: dict[str, Any] = {}
    try:
        folder = _close(asked, load, run, felt_of, so_far, quiet=as_json)
    except typer.Exit as end:  # of a later run, which said its cause
        if end.exit_code == FAULT and so_far:
            _print(so_far, None, as_json=as_json)
        raise
    except OSError as error:
        if error.errno not in DISK_FULL or not so_far:
            raise
        written = error.filename or asked.out or "a result"
        problem = (
            f"{written}: cannot be written: {error.strerror}: make room, or name another folder"
            " with --out; the answer so far is printed above"
        )
        _print(so_far | {"problem": problem}, None, as_json=as_json)
        print(problem, file=sys.stderr)
        raise typer.Exit(FAULT) from None
    _print(so_far, folder, as_json=as_json)


def _close(
    asked: Asked,
    load: LoadTrial,
    run: RunFolder,
    felt_of: FeltOf,
    so_far: dict[str, Any],
    *,
    quiet: bool,
) -> Path:
    """Close the loop, and write loop.json and its page into the folder that it returns.

    `so_far` gets the answer as far as it is known.
    """
    begun, residuals = time.perf_counter(), None
    interruptions_before = interruptions()
    with phases_of_command("diagnosis", quiet=quiet) as shown:
        if asked.trial_file is not None and asked.recording is None and asked.test is None:

            def run_shown(trial_file: Path, changes: list[str], clock: Clock, into: Path) -> Any:
                _end_if_interrupted_after(interruptions_before)
                with shown.phase(_PHASES[into.name]):
                    return run(trial_file, changes, clock, into)

            folder, answer = _on_trial(asked, asked.trial_file, load, run_shown, so_far.update)
        elif asked.recording is not None and asked.test is not None and asked.trial_file is None:
            folder, answer, residuals = _on_recordings(
                asked, asked.recording, asked.test, so_far.update
            )
        else:
            raise RecordingError("give a trial, or both --recording and --test")
    _end_if_interrupted_after(interruptions_before)
    answer["seconds"] = round(time.perf_counter() - begun, 1)
    answer["phases"] = shown.taken
    answer["finished_at"] = datetime.now().astimezone().isoformat(timespec="seconds")
    so_far |= answer
    write_json(folder / "loop.json", answer)
    with bar("writing the page", counts=False):
        _write_page(plain_json(answer), folder, felt_of, residuals)
    return folder


def _print(answer: Mapping[str, Any], folder: Path | None, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(plain_json(answer)), flush=True)
    else:
        _show(output(), answer, folder)


def _end_if_interrupted_after(before: int) -> None:
    """Raise KeyboardInterrupt where one came, and was lost in a call from compiled code."""
    if interruptions() > before:
        raise KeyboardInterrupt


def _write_page(
    answer: Mapping[str, Any], folder: Path, felt_of: FeltOf, residuals: Residuals | None
) -> None:
    """Write the page where the extra `report` is installed."""
    try:
        from teleop_rt.view.loop_page import write_loop_page  # noqa: PLC0415 - an extra
    except ImportError:
        report_missing_page()
        return
    write_loop_page(answer, folder, felt_of, residuals)


def _on_trial(
    asked: Asked, trial_file: Path, load: LoadTrial, run: RunFolder, keep: Keep
) -> tuple[Path, dict[str, Any]]:
    changes = list(asked.overrides)
    changes += [f"effects_file={asked.effects.resolve()}"] if asked.effects is not None else []
    trial = load(trial_file, changes)
    base = asked.base or trial.estimation.models[0]
    load(trial_file, [*changes, f"estimation.models=[{base}]"])  # before anything moves
    own = Path(trial.effects_file) if trial.effects_file else None
    with folder_if_filled(asked.out, f"{trial.name}-loop") as folder:
        return folder, close_loop(
            trial,
            base,
            lambda more, into: run(trial_file, [*changes, *more], asked.clock, into),
            library(own),
            folder,
            keep,
        )


def _on_recordings(
    asked: Asked, recording: Path, test: Path, keep: Keep
) -> tuple[Path, dict[str, Any], Residuals]:
    recording, test = recording_of(recording), recording_of(test)
    with new_folder(asked.out, f"{recording.stem}-loop") as folder:
        refuse_itself(recording, test)
        files = Files(recording, test, asked.table, asked.effects)
        return folder, *close_recordings(files, asked.base or "kelvin-voigt", folder, keep)


def _show(console: Console, answer: Mapping[str, Any], folder: Path | None) -> None:
    withdrawn = bool(answer.get("withdrawn"))
    verdict = answer["verdict"].replace("_", " ") + ", model withdrawn" * withdrawn
    console.print(f"[bold]{escape(answer.get('trial') or answer['recording'])}[/bold]: {verdict}")
    if answer.get("reason"):
        console.print(f"  {answer['reason']}", highlight=False)
    print_effects(console, answer)
    print_draft(console, answer)
    if (shift := answer.get("surface_shift")) is not None:
        where = "deep" if shift["value"] > 0.0 else "shallow"
        size = f"{SMALL * abs(shift['value']):.2g} {small(shift['unit'])}"
        line = f"  the surface of the run was {size} too {where}: it is found again in each run"
        console.print(line, highlight=False)
    if (fresh := answer["fresh"]) is not None:
        of = "in the withdrawn model " if withdrawn else ""
        for one in fresh["handled"]:
            console.print(f"  {of}{one['name']} is {one['where']}: {one['how']}", highlight=False)
        for words, error in (
            ("slave, force predicted in free run", fresh["slave"]["free_run"]),
            ("slave, force predicted on-line", fresh["slave"]["on_line"]),
            ("master, force felt", fresh["master"]),
        ):
            before, after = (number(error[key]) for key in ("before", "after"))
            if error["before"] is not None or error["after"] is not None:
                console.print(f"  {words}: NRMSE before {before}, after {after}", highlight=False)
            elif error.get("reason"):
                console.print(f"  {words}: {error['reason']}", highlight=False)
    if folder is not None:
        console.print(f"files in {folder}", highlight=False)
