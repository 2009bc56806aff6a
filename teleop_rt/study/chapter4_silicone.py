"""The experiment of section 4.2: a silicone cube pressed at 3 Hz, on the rig and in closed form.

The rig's trial runs in lock-step, bytes and all. Its simulated cube is linear; the report's cube
may not have been. So a second, curved cube is pressed in closed form, and shows which of the
report's statements depend on the material.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.batch.workers import Case, Result
from teleop_rt.config.loader import dump
from teleop_rt.config.trial import TrialConfig
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import report_with_delays
from teleop_rt.estimation.rows import rows_for
from teleop_rt.estimation.trace import Trace
from teleop_rt.realtime.reading import read_topics
from teleop_rt.signals import SLAVE_TOPIC
from teleop_rt.study.chapter4_plant import (
    TRUTH,
    PenetrationMotion,
    SensorErrors,
    Signal,
    Sine,
    plant_force,
)
from teleop_rt.trial.bench import OpenBench
from teleop_rt.trial.estimators import pipeline_settings
from teleop_rt.trial.folder import RECORDING, write_trial
from teleop_rt.trial.lockstep_run import run_lockstep

CURVED = {"k": 14000.0, "b": 160.0, "n": 1.3}
"""A cube that stiffens as it is pressed; about as stiff at 12 mm as the rig's."""
SHOWN = (("direct", "rls"), ("direct", "iec"), ("algebraic", "rls"))
"""The three methods of figures 4.6 to 4.9."""
SETTLED_AFTER_S = 1.5
"""Time in contact from which errors count."""
_POINTS = 400  # per curve
_WINDOW_S = 0.7  # two periods at 3 Hz
_SLOW_SHARE = 0.2  # of the speed: below it the motion turns over


@dataclass(frozen=True, slots=True)
class Specimen:
    """A cube on a rig: where the trial's file is, and how its simulated rig is opened."""

    trial: TrialConfig
    trial_file: Path
    open_bench: OpenBench
    folder: Path

    def cases(self) -> list[Case]:
        """Return the two cubes; the rig's case names its trial by a digest."""
        plain = json.dumps(dump(self.trial, self.trial.rig.units), sort_keys=True, default=str)
        digest = hashlib.sha256(plain.encode()).hexdigest()[:16]
        common = {"part": "silicone", "seed": self.trial.seed, "duration_s": self.trial.duration_s}
        return [
            common | {"specimen": "rig", "trial": digest},
            common | {"specimen": "curved", "trial": digest},
        ]

    def press(self, case: Case) -> Result:
        """Press one cube and identify it by every method."""
        settings = pipeline_settings(self.trial)
        if case["specimen"] == "rig":
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir(parents=True)
            write_trial(self.folder, self.trial)
            run_lockstep(
                self.trial, self.trial_file, self.open_bench, self.folder, lambda _seconds: None
            )
            rows = read_topics(self.folder / RECORDING, [SLAVE_TOPIC])[SLAVE_TOPIC]
            position, measured, valid = rows["position"], rows["force"], rows["valid"] > 0
        else:
            sensors = SensorErrors(settings.force_noise, settings.position_resolution)
            profile = Sine(duration_s=case["duration_s"])
            position, measured = sensors.record(profile, "hunt-crossley", CURVED, case["seed"])
            valid = np.ones(position.size, dtype=np.bool_)
            settings = replace(settings, surface=0.0, force_lag_s=0.0)
        return {"specimen": case["specimen"]} | identify(settings, position, measured, valid)


def identify(
    settings: PipelineSettings, position: Signal, measured: Signal, valid: NDArray[np.bool_]
) -> Result:
    """Return the estimates of every method from a record: position, force, valid (n,)."""
    pipeline = Pipeline(rows_for(TRUTH), settings)
    trace = pipeline.run(position, measured, valid)
    rows = report_with_delays(pipeline, trace)
    kept = np.linspace(0, len(trace.signals) - 1, min(_POINTS, len(trace.signals))).astype(int)
    settled = _settled(trace)
    window = _window(trace)
    methods = []
    for row, one in enumerate(rows):
        values = {name: trace.physical(row, name) for name in trace.names(row)}
        estimated = trace.status[:, row] > 0
        last = {name: float(value[-1]) for name, value in values.items()}
        methods.append(
            {key: one[key] for key in ("model", "regression", "solver", "status", "nrmse")}
            | {"final": last, "convergence_s": one["convergence_s"]}
            | {"wander": {n: _wander(v[settled & estimated]) for n, v in values.items()}}
            | {"turning": _turning(one["model"], last, trace, settled)}
            | {
                "trace": {
                    n: _short(np.where(estimated, v, np.nan)[kept]) for n, v in values.items()
                }
            }
            | {"force": _short(_predicted(one["model"], values, trace)[window])}
        )
    return {
        "t_s": _short(kept * trace.period_s),
        "window": {
            "t_s": _short(window * trace.period_s),
            "force": _short(trace.signals[window, 7]),
        },
        "methods": methods,
    }


def _short(values: NDArray[np.floating[Any]]) -> list[float | None]:
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def _settled(trace: Trace) -> NDArray[np.bool_]:
    """Return where (n,) contact lasts and the time to converge is over."""
    contact = trace.signals[:, 0] > 0.0
    elapsed = np.cumsum(contact) * trace.period_s
    settled: NDArray[np.bool_] = contact & (elapsed > SETTLED_AFTER_S)
    return settled


def _window(trace: Trace) -> NDArray[np.int64]:
    """Return the samples of the last stretch of contact, two periods at 3 Hz."""
    last = int(np.flatnonzero(trace.signals[:, 0] > 0.0)[-1])
    length = round(_WINDOW_S / trace.period_s)
    contact = np.convolve(trace.signals[: last + 1, 0], np.ones(length), "valid")
    whole = np.flatnonzero(contact == length)
    start = int(whole[-1]) if whole.size else max(0, last - length)
    # Well before the end, where the tool may be lifting off already.
    start = max(0, start - length)
    return np.arange(start, start + length)


def _wander(values: Signal) -> float | None:
    """Return the range of a parameter over its median, once converged; None without any."""
    if values.size == 0:
        return None
    return float(np.ptp(values) / max(abs(float(np.median(values))), 1e-12))


def _predicted(model: str, values: dict[str, Any], trace: Trace) -> Signal:
    """Return the force (n,) by parameters, of each moment or one for all, at the motion seen."""
    x, v = trace.signals[:, 3], trace.signals[:, 4]
    # Before a row is estimated its parameters may be anything.
    with np.errstate(over="ignore", invalid="ignore"):
        return plant_force(model, values, PenetrationMotion(x, x, v, np.zeros_like(v)))


def _turning(
    model: str, final: dict[str, float], trace: Trace, settled: NDArray[np.bool_]
) -> float | None:
    """Return the RMS force error where the motion turns over that elsewhere; None without both."""
    error = trace.signals[:, 7] - _predicted(model, final, trace)
    speed = np.abs(trace.signals[:, 4])
    if not np.any(settled):
        return None
    slow = speed < _SLOW_SHARE * float(np.quantile(speed[settled], 0.99))
    rms = partial(_rms, error)
    turning, elsewhere = rms(settled & slow), rms(settled & ~slow)
    return turning / elsewhere if elsewhere > 0.0 else None


def _rms(values: Signal, where: NDArray[np.bool_]) -> float:
    return float(np.sqrt(np.mean(values[where] ** 2))) if np.any(where) else 0.0
