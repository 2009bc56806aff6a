"""The summary of a run that ended before it could write one, from its recording."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.slave.faults import FAULTS, State
from teleop_rt.trial.felt_force import EnvironmentForce
from teleop_rt.trial.late import recorded
from teleop_rt.trial.simulated_advice import next_step_of
from teleop_rt.trial.summary import summarise

_INCOMPLETE = "the run ended before its processes could report their counts"


def rebuilt_summary(
    folder: Path,
    trial: TrialConfig,
    slave: Mapping[str, NDArray[np.float64]],
    environment_force: EnvironmentForce | None,
) -> dict[str, Any]:
    """Return a summary as `run` writes it; values that only the processes knew are null, and noted.

    `slave` holds the ticks of the slave that can be read, at least one.
    """
    state, fault = int(slave["state"][-1]), FAULTS.get(int(slave["fault"][-1]))
    simulated = trial.plant is not None
    reported = {
        "code": None if fault is None else fault.code,
        "name": "unknown" if fault is None else fault.name,
        "cause": _INCOMPLETE if fault is None else fault.cause,
        "next_step": "read log.jsonl"
        if fault is None
        else next_step_of(fault, simulated=simulated),
    }
    counts = ("sent", "received", "lost", "overtaken", "rejected", "refused", "round_trip_ms")
    measured = bool(np.any(np.isfinite(slave["work_us"])))
    outcome: dict[str, Any] = {
        "clock": "real" if measured else "simulated",
        "missed_ticks": int(slave["tick"][-1] - slave["tick"][0]) + 1 - slave["tick"].size,
        "late": recorded(slave, trial.rig.realtime.late, trial.rig.period_ns),
        "link": dict.fromkeys(counts),
        "rendering": None,
        "safety": {"state": State(state).name, "fault": reported},
        "recorder": {"dropped": None},
    }
    summary = summarise(folder, trial, outcome, environment_force)
    summary["notes"].append(f"{_INCOMPLETE}: this summary uses only the recording")
    return summary
