"""The estimators of a trial: built from its config, and replayed over its recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config import TrialConfig
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import report_with_delays
from teleop_rt.estimation.rows import RowSpec, rows_for
from teleop_rt.offline.load import ONLINE, online_metadata

Array = NDArray[np.float64]
_NOTHING = np.empty(0)


def pipeline_settings(trial: TrialConfig) -> PipelineSettings:
    """Return the settings of the estimation pipeline that a trial asks for."""
    chosen, contact, sensors = trial.estimation, trial.contact, trial.rig.sensors
    return PipelineSettings(
        period_s=trial.rig.period_ns * 1e-9,
        position_resolution=sensors.position_resolution,
        force_noise=sensors.force_noise,
        force_lag_s=sensors.force_lag_ms * 1e-3,
        onset_force=contact.onset_force,
        release_force=contact.release_force,
        onset_samples=contact.onset_samples,
        release_samples=contact.release_samples,
        free_air_s=contact.free_air_ms * 1e-3,
        differentiator=chosen.differentiator.kind,
        cutoff_hz=chosen.differentiator.cutoff_hz,
        forgetting_factor=chosen.forgetting_factor,
    )


def trial_rows(trial: TrialConfig) -> list[RowSpec]:
    """Return the rows of the bank that a trial asks for."""
    chosen = trial.estimation
    return rows_for(chosen.models, chosen.regressions, chosen.solvers)


def make_pipeline(trial: TrialConfig) -> Pipeline:
    """Return the estimation pipeline that a trial asks for, compiled and at its start."""
    pipeline = Pipeline(trial_rows(trial), pipeline_settings(trial))
    pipeline.update(0.0, 0.0, False)  # noqa: FBT003 - a missing sample, to compile before arming
    pipeline.reset()
    return pipeline


def recording_metadata(trial: TrialConfig) -> dict[str, dict[str, str]]:
    """Return what a recording says of itself, so that it can be replayed as it ran."""
    units = (trial.rig.units.position, trial.rig.units.force)
    return {ONLINE: online_metadata(pipeline_settings(trial), trial_rows(trial), units)}


@dataclass(frozen=True, slots=True)
class Replayed:
    """What the estimators found, told from the recorded samples."""

    estimators: list[dict[str, Any]]
    selected: dict[str, Any] | None
    surface_reason: str
    surface: float
    theta: NDArray[np.float64]


def replay_estimators(trial: TrialConfig, slave: Mapping[str, Array]) -> Replayed:
    """Run the recorded samples of the slave through the same kernels as on-line."""
    pipeline = make_pipeline(trial)
    trace = pipeline.run(
        slave.get("position", _NOTHING),
        slave.get("force", _NOTHING),
        slave.get("valid", _NOTHING) > 0,
    )
    rows = report_with_delays(pipeline, trace, trial.rig.units.position, trial.rig.units.force)
    chosen = pipeline.selected
    keys = ("model", "regression", "solver", "parameters")
    return Replayed(
        estimators=rows,
        selected={key: rows[chosen][key] for key in keys} if chosen >= 0 else None,
        surface_reason=pipeline.surface_reason or "",
        surface=pipeline.contact.surface,
        theta=pipeline.theta.copy(),
    )
