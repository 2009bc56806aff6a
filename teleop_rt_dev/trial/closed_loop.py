"""Trials run in lock-step, and the loop closed over them, as the command line does it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from teleop_rt.cli.wiring import open_bench
from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.offline.closing import close_loop
from teleop_rt.trial.folder import write_json, write_trial
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt_dev.paths import TRIALS
from teleop_rt_dev.trial.files import load
from teleop_rt_drivers.simulated.reference import environment_force

FOAM = TRIALS / "stiffening_foam.yaml"


def run_into(folder: Path, *changes: str, file: Path = FOAM) -> dict[str, Any]:
    """Run the trial with these overrides on the simulated clock and return its summary."""
    trial = load(file, *changes)
    folder.mkdir(parents=True)
    write_trial(folder, trial)
    outcome = run_lockstep(trial, file, open_bench, folder, lambda _: None)
    summary = summarise(folder, trial, outcome, environment_force)
    write_json(folder / "summary.json", summary)
    return summary


def closed(out: Path, *changes: str, library: tuple[Effect, ...] = LIBRARY) -> dict[str, Any]:
    """Close the loop over the foam's trial with these overrides and return the answer."""
    return close_loop(
        load(FOAM, *changes), "kelvin-voigt",
        lambda more, into: run_into(into, *changes, *more), library, out,
    )  # fmt: skip
