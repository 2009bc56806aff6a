"""A whole trial, from its file to its summary: the work of the command `run`."""

from __future__ import annotations

import json
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, nullcontext, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import typer
from rich.console import Console

from teleop_rt.batch.bar import bar
from teleop_rt.cli.leaving import leave_on_fault
from teleop_rt.cli.options import ClockName
from teleop_rt.cli.reporting import felt_of
from teleop_rt.cli.showing import live_page_beside
from teleop_rt.cli.side_mains import run_side
from teleop_rt.cli.wiring import load_trial_file, load_trial_for_run, open_bench, require_files
from teleop_rt.config.trial import TrialConfig
from teleop_rt.config.yaml_file import OVERRIDE, ConfigError, ConfigProblem
from teleop_rt.contact.effects.user import library
from teleop_rt.errors import FAULT
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.precompile import compile_ticks, is_compiled
from teleop_rt.estimation.rows import whole_for
from teleop_rt.extras import install_command
from teleop_rt.interrupts import INTERRUPTED, Interrupts
from teleop_rt.kernels.jit import kernel_folder
from teleop_rt.link import packet_kernels
from teleop_rt.master.rendered_effects import RenderedEffects
from teleop_rt.realtime import lateness
from teleop_rt.slave.step import compile_step
from teleop_rt.trial.estimators import (
    make_pipeline,
    pipeline_settings,
    trial_extension,
    trial_rows,
)
from teleop_rt.trial.folder import new_folder, plain_json, write_json, write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.processes import ProcessFailedError
from teleop_rt.trial.run_processes import run_processes
from teleop_rt.trial.summary import summarise
from teleop_rt.trial.table import print_summary
from teleop_rt.view.console import output
from teleop_rt.view.terminal import RunView
from teleop_rt_drivers import registry
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
from teleop_rt_drivers.simulated.plant import Plant
from teleop_rt_drivers.simulated.reference import environment_force

_NOT_BEGUN = "interrupted before the trial began"
_NO_CACHE = (
    "no folder can be written for compiled kernels: each run compiles them again, which takes"
    " about a minute; name one with NUMBA_CACHE_DIR or XDG_CACHE_HOME"
)


@contextmanager
def names_as_typed(typed: Mapping[str, str]) -> Iterator[None]:
    """Name the options that gave changes of a config in problems with these changes."""
    try:
        yield
    except ConfigError as error:
        places = {OVERRIDE + change: option for change, option in typed.items()}
        problems = [
            ConfigProblem(places.get(one.where, one.where), one.message) for one in error.problems
        ]
        raise ConfigError(problems) from None


def run_and_print(
    trial_file: Path,
    changes: list[str],
    clock: ClockName,
    out: Path | None,
    live_port: int | None,
    *,
    as_json: bool,
) -> None:
    """Run a trial, with a live page where it has a port, and print its summary."""
    trial = _load(trial_file, changes, clock)
    require_files(trial, trial_file)
    compile_first(trial, quiet=as_json)
    with Interrupts() as interrupts:
        try:
            with nullcontext() if live_port is None else live_page_beside(live_port):
                folder, summary, failure = _run(trial, trial_file, clock, out, interrupts)
                _print(folder, summary, trial, as_json=as_json)
                if live_port is not None and sys.stdin.isatty():
                    _stay()
        except KeyboardInterrupt:
            print(_NOT_BEGUN, file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from None
        _finish(summary, failure)


def _print(folder: Path, summary: dict[str, Any], trial: TrialConfig, *, as_json: bool) -> None:
    if as_json:
        print(json.dumps(plain_json(summary)), flush=True)
        return
    console = output()
    print_summary(console, summary, trial.rig.units)
    console.print(f"files in {folder}", highlight=False)


def _stay() -> None:
    """Keep the live page of a run that has ended until somebody who watches a terminal ends it."""
    with suppress(KeyboardInterrupt):
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        print("the live page stays as the run left it: end with Ctrl-C", file=sys.stderr)
        signal.pause()
    signal.signal(signal.SIGINT, before)


def _load(trial_file: Path, changes: list[str], clock: ClockName) -> TrialConfig:
    load = load_trial_for_run if clock == ClockName.REAL else load_trial_file
    return load(trial_file, changes)


def compile_first(trial: TrialConfig, *, quiet: bool) -> None:
    """Compile the kernels of a run of the trial that the cache lacks; print how long it took.

    Slave, master, rig and summary would compile it too, each on one core and silently.
    """
    whole = whole_for(trial_rows(trial, trial_extension(trial)))
    if is_compiled(whole):
        if kernel_folder(Path(__file__)) is None and not quiet:
            print(_NO_CACHE, file=sys.stderr, flush=True)
        return
    begun = time.perf_counter()
    if not quiet:
        announcement = (
            "compiling estimators, rig and effects, once for this version and processor ... "
        )
        print(announcement, end="", file=sys.stderr, flush=True)
    compile_ticks(whole, partial(_compile_replay, trial), partial(_compile_sides, trial))
    if not quiet:
        print(f"{time.perf_counter() - begun:.1f} s", file=sys.stderr)


def _compile_replay(trial: TrialConfig) -> None:
    """Compile the kernels of a replay, and those of the estimators that the cache lacks."""
    one = np.zeros(1)
    make_pipeline(trial).run(one, one, np.zeros(1, dtype=np.bool_))


def _compile_sides(trial: TrialConfig) -> None:
    """Compile the kernels that set up estimators, decide, render, and move a simulated rig."""
    Pipeline(trial_rows(trial, trial_extension(trial)), pipeline_settings(trial))
    compile_step()
    own = Path(trial.effects_file) if trial.effects_file else None
    RenderedEffects(library(own), deepest=1.0, speed=1.0)
    packet_kernels.load_kernels()
    lateness.load_kernels()
    if isinstance(trial.plant, SimulatedPlantConfig):
        Plant(trial.plant, 0, trial.seed)


def _run(
    trial: TrialConfig,
    trial_file: Path,
    clock: ClockName,
    out: Path | None,
    interrupts: Interrupts,
) -> tuple[Path, dict[str, Any], ProcessFailedError | None]:
    """Run the trial into a new folder; return folder, summary, and the process that failed."""
    with new_folder(out, trial.name) as folder:
        write_trial(folder, trial)
        failure: ProcessFailedError | None = None
        with RunView(Console(stderr=True), trial.name, trial.duration_s) as progress:
            if clock == ClockName.SIMULATED:
                outcome = run_lockstep(
                    trial, trial_file, partial(open_bench, folder=folder), folder, progress
                )
            else:
                side = partial(run_side, trial, trial_file)
                reached_by = registry.reached_by(trial.rig)
                outcome, failure = run_processes(
                    trial, side, folder, progress, reached_by, interrupts.hold
                )
        interrupts.hold()
        if outcome["interrupted"]:
            print("interrupted: the axis is off; writing summary and report", file=sys.stderr)
        reference = environment_force if trial.plant is not None else None
        with bar("", counts=False, lines=True) as shown:
            shown.phase("reading the recording")
            summary = summarise(folder, trial, outcome, reference)
            shown.phase("writing the report")
            try:
                write_json(folder / "summary.json", summary)
                _report(folder, summary)
            except OSError as error:
                message = (
                    f"{folder}: summary and report cannot be written: {error.strerror}: make"
                    f" room, then run `teleop-rt report {folder}`"
                )
                failure = failure or ProcessFailedError(message, FAULT)
    return folder, summary, failure


def _report(folder: Path, summary: dict[str, Any]) -> None:
    """Write report.html where the extra `report` is installed and a tick was recorded."""
    try:
        from teleop_rt.view.commands import report_of_run  # noqa: PLC0415 - an extra may be absent
    except ImportError:
        print(f"no report.html: `{install_command('report')}` adds it", file=sys.stderr)
        return
    report_of_run(folder, plain_json(summary), felt_of)


def _finish(summary: dict[str, Any], failure: ProcessFailedError | None) -> None:
    """Leave with the exit code of the run, after printing the cause of a failure."""
    if failure is not None:
        print(failure, file=sys.stderr)
        raise typer.Exit(failure.code)
    leave_on_fault(summary["safety"], "start the run again")


def run_in(trial_file: Path, changes: list[str], clock: str, folder: Path) -> Mapping[str, Any]:
    """Run a trial of its own into a folder; return its summary, or leave on a fault or Ctrl-C."""
    trial = _load(trial_file, changes, ClockName(clock))
    require_files(trial, trial_file)
    with Interrupts() as interrupts:
        try:
            _, summary, failure = _run(trial, trial_file, ClockName(clock), folder, interrupts)
        except KeyboardInterrupt:
            print(f"{_NOT_BEGUN}; nothing further is run", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from None
    _finish(summary, failure)
    if summary["interrupted"] or interrupts.came:  # also while summary and report were written
        print(
            f"interrupted: {folder} keeps the recording so far; nothing further is run",
            file=sys.stderr,
        )
        raise typer.Exit(INTERRUPTED)
    return summary
