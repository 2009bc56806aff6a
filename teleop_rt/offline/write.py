"""The files of a diagnosis: page, extended model, and proposed motion."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from teleop_rt.config.yaml_file import read_yaml
from teleop_rt.diagnosis.answers import extended
from teleop_rt.diagnosis.answers.experiment import Experiment
from teleop_rt.diagnosis.answers.residuals import residuals_of
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.extras import install_command
from teleop_rt.recordings.excerpt import most_active
from teleop_rt.recordings.recording import Recording

Keep = Callable[[dict[str, Any]], None]
"""Gets an answer as far as it is known, so that a full disk does not lose it."""
KEPT = (
    *("base", "verdict", "effects", "class", "family"),
    *("probability", "nearest", "dependence", "draft"),
)
"""Keys of a diagnosis' answer that the answer of a closed loop has, too."""
NOT_YET = {"extended_model": None, "withdrawn": None, "fresh": None}
"""Entries of the answer of a closed loop that a diagnosis alone does not give."""
_LEAD_IN_S = 1.0
"""Rest before a proposed motion: the axis goes to its first position in it."""
_MOTION, _EXPERIMENT = "motion.csv", "experiment.yaml"


def ignore(_answer: dict[str, Any]) -> None:
    """Keep nothing of an answer so far."""


def write_diagnosis(found: Diagnosis, recording: Recording, path: Path, folder: Path) -> None:
    """Write page and figures (with the extra `report`), model.yaml and the proposed trial.

    The trial is that of the run whose recording it is, with another motion; a foreign recording
    gets the motion alone. Its path goes into the answer.
    """
    folder.mkdir(parents=True, exist_ok=True)
    for name in (_MOTION, _EXPERIMENT):  # of a diagnosis that is resumed
        (folder / name).unlink(missing_ok=True)
    if found.experiment is not None:
        motion, column = folder / _MOTION, f"position_{recording.units[0]}"
        _write_motion(motion, found.experiment, _surface(found, recording), column)
        trial = path.with_name("trial.yaml")
        if trial.is_file():
            proposed = _propose(trial, motion, found.experiment, column)
            written = folder / _EXPERIMENT
            written.write_text(yaml.safe_dump(proposed, sort_keys=False), encoding="utf-8")
            found.answer["experiment"]["trial"] = str(written)
    try:
        from teleop_rt.view.diagnosis_page import write  # noqa: PLC0415 - an extra may be absent
    except ImportError:
        extended.write(folder / "model.yaml", found.answer)
    else:
        write(found.answer, residuals_of(found, recording.units), folder)


def report_missing_page() -> None:
    """Report on standard error where the extra that draws pages is missing."""
    try:
        import teleop_rt.view.diagnosis_page  # noqa: F401, PLC0415 - as below
    except ImportError:
        print(f"no page: `{install_command('report')}` adds it to the next one", file=sys.stderr)


def _surface(found: Diagnosis, recording: Recording) -> float:
    """Return where the surface was taken to be, in the recording's own coordinate."""
    part, _ = most_active(recording)
    x = found.problem.motion.x
    return float(np.median(part.position[: x.size] - x))


def _write_motion(path: Path, experiment: Experiment, surface: float, column: str) -> None:
    """Write the motion, its columns with units: at rest first, so that the slave can follow."""
    lead = np.arange(0.0, _LEAD_IN_S, float(experiment.t[1] - experiment.t[0]))
    t = np.concatenate((lead, _LEAD_IN_S + experiment.t))
    x = np.concatenate((np.full(lead.size, experiment.x[0]), experiment.x))
    table = np.column_stack((t, surface + x))
    np.savetxt(path, table, delimiter=",", header=f"t_s,{column}", comments="", fmt="%.9g")


def _propose(trial: Path, motion: Path, experiment: Experiment, column: str) -> dict[str, Any]:
    proposed: dict[str, Any] = dict(read_yaml(trial).data)
    proposed["name"] = f"{proposed['name']}_experiment"
    proposed["duration_s"] = float(_LEAD_IN_S + experiment.t[-1] + 1.0)
    proposed["operator"] = {
        "kind": "recorded",
        "file": str(motion.resolve()),
        "time_column": "t_s",
        "position_column": column,
    }
    return proposed
