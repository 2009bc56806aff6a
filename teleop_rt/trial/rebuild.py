"""The summary of a run from its recording: it wrote none, or one of more than is recorded here."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.slave.faults import FAULTS, State
from teleop_rt.slave.simulated_advice import next_step_of
from teleop_rt.trial.felt_force import EnvironmentForce
from teleop_rt.trial.late import recorded
from teleop_rt.trial.summary import summarise

_REPORTED = ("began_at", "software", "clock", "seed")
"""Keys of a summary that are true of every part of its run."""
_INCOMPLETE = "the run ended before its processes could report their counts"


def rebuilt_summary(
    folder: Path,
    trial: TrialConfig,
    slave: Mapping[str, NDArray[np.float64]],
    environment_force: EnvironmentForce | None,
    written: Mapping[str, Any] | None = None,
) -> dict[str, Any]:
    """Return a summary as `run` writes it; values that only the processes knew are null, and noted.

    `slave` holds the ticks of the slave that can be read, at least one. `written` is the summary
    that the run wrote, if any, of a recording that lacks ticks now.
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
    if written is not None:
        outcome["missed_ticks"] = None  # ticks that cannot be read are not those that were missed
        outcome["safety"]["fault"] = written["safety"]["fault"]
    summary = summarise(folder, trial, outcome, environment_force)
    if written is None:
        summary["notes"].append(f"{_INCOMPLETE}: this summary uses only the recording")
        return summary
    summary["notes"].append("summary.json is of the whole run; this one uses only the recording")
    return summary | {key: written[key] for key in _REPORTED if key in written}
