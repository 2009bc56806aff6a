"""Data computed for a report: a missing summary, and the felt force."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.trial.felt_force import Columns, Felt, felt_force, read_truth, rows_to_compare
from teleop_rt.trial.folder import TRIAL
from teleop_rt.trial.rebuild import rebuilt_summary
from teleop_rt_drivers.simulated.reference import environment_force


def rebuilt(
    folder: Path, slave: Mapping[str, Any], written: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the summary of a recording whose run wrote none, or one of a longer recording."""
    trial = load_trial_file(folder / TRIAL, None)
    reference = environment_force if trial.plant is not None else None
    return rebuilt_summary(folder, trial, slave, reference, written)


def felt_of(folder: Path, slave: Columns, master: Columns) -> Felt | None:
    """Return the felt force of a run beside its true environment's; None where that is unknown."""
    trial = load_trial_file(folder / TRIAL, None)
    truth = read_truth(folder)
    rows = rows_to_compare(slave, master)
    if trial.plant is None or truth is None or not rows:
        return None
    return felt_force(trial, rows, truth, environment_force)
