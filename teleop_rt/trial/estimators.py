"""The estimators of a trial: built from its config, and replayed over its recording."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.realtime import RecordingConfig
from teleop_rt.config.trial import TrialConfig
from teleop_rt.contact.fitted import ExtendedModelError
from teleop_rt.estimation.extension import Extension, extension_from
from teleop_rt.estimation.pairing import CUTOFF_SHARE
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.recorded import estimated_samples
from teleop_rt.estimation.report import KEYS, report_with_delays
from teleop_rt.estimation.rows import RowSpec, rows_for
from teleop_rt.realtime.recording import BEGAN_AT, ONLINE, RUN, SIMULATED
from teleop_rt.realtime.rotation import SIZES

Array = NDArray[np.float64]
# A lag of the force is at most so long; only then the effects are asked for the first time.
_COMPILING_TICKS = 300
LEAST_EDGE_SAMPLES = 2
"""Samples that begin or end a contact at least: one alone may be an outlier."""


def pipeline_settings(trial: TrialConfig) -> PipelineSettings:
    """Return the settings of the estimation pipeline that a trial asks for."""
    chosen, contact, sensors = trial.estimation, trial.contact, trial.rig.sensors
    period_s = trial.rig.period_ns * 1e-9
    stamp_deviation_s = trial.rig.axis.stamp_deviation_s(period_s)
    settings = PipelineSettings(
        period_s=period_s,
        position_resolution=sensors.position_resolution,
        force_noise=sensors.force_noise,
        force_lag_s=sensors.force_lag_ms * 1e-3,
        force_lag_deviation_s=math.hypot(sensors.force_lag_deviation_ms * 1e-3, stamp_deviation_s),
        friction_deviation=sensors.friction_deviation,
        onset_force=contact.onset_force,
        release_force=contact.release_force,
        onset_samples=contact.onset_samples,
        release_samples=contact.release_samples,
        free_air_s=contact.free_air_ms * 1e-3,
        surface_tracking_hz=contact.surface_tracking_hz,
        differentiator=chosen.differentiator.kind,
        cutoff_hz=chosen.differentiator.cutoff_hz,
        forgetting_factor=chosen.forgetting_factor,
    )
    if trial.rig.sample_period_ns == trial.rig.period_ns and not trial.rig.axis.paired:
        return settings
    settling_s = sensors.force_settling_ms * 1e-3
    return _paired(settings, trial.rig.sample_period_ns * 1e-9, settling_s)


def _paired(settings: PipelineSettings, period_s: float, settling_s: float) -> PipelineSettings:
    """Return the settings for pairs of slow sensors: the same durations in longer periods."""
    share = settings.period_s / period_s
    return replace(
        settings,
        period_s=period_s,
        force_lag_s=0.0,
        paired_lag_s=settings.force_lag_s,
        paired_settling_s=settling_s,
        cutoff_hz=min(settings.cutoff_hz, CUTOFF_SHARE / period_s),
        onset_samples=max(LEAST_EDGE_SAMPLES, math.ceil(share * settings.onset_samples)),
        release_samples=max(LEAST_EDGE_SAMPLES, math.ceil(share * settings.release_samples)),
    )


def trial_extension(trial: TrialConfig) -> Extension | None:
    """Return the trial's extended model, None without one.

    Raises ExtendedModelError where it does not fit the trial, EffectError for a user's effect.
    """
    extended = trial.extended_model
    if extended is None:
        return None
    extension = extension_from("extended_model", extended.model_dump(), trial.effects_file)
    if extension.base not in trial.estimation.models:
        raise ExtendedModelError(
            f"extended_model: base: {extension.base} is not among estimation.models"
            f" ({', '.join(trial.estimation.models)}): add it, for the effects were"
            " fitted beside it"
        )
    return extension


def trial_rows(trial: TrialConfig, extension: Extension | None = None) -> list[RowSpec]:
    """Return the rows of the bank that a trial asks for: those of an extension's base beside it."""
    chosen = trial.estimation
    rows = rows_for(chosen.models, chosen.regressions, chosen.solvers)
    return rows if extension is None else extension.rows(rows)


def make_pipeline(trial: TrialConfig) -> Pipeline:
    """Return the estimation pipeline that a trial asks for, compiled and at its start."""
    extension = trial_extension(trial)
    settings = pipeline_settings(trial)
    if extension is not None:
        settings = extension.settings(settings)
    pipeline = Pipeline(trial_rows(trial, extension), settings)
    pipeline.update(0.0, 0.0, False)  # noqa: FBT003 - a missing sample, to compile before arming
    if extension is not None:
        for _ in range(_COMPILING_TICKS):
            pipeline.update(0.0, 0.0, True)  # noqa: FBT003 - the effects, too
    pipeline.reset()
    return pipeline


def recording_metadata(
    trial: TrialConfig, began_at: str | None = None
) -> dict[str, dict[str, str]]:
    """Return the metadata of a recording, which allow an exact replay.

    `began_at` is the date, for its stamps have none; None where a recording is to be repeatable.
    """
    units = (trial.rig.units.position, trial.rig.units.force)
    extension = trial_extension(trial)
    rows = trial_rows(trial, extension)
    extended = None if trial.extended_model is None else trial.extended_model.model_dump()
    online = online_metadata(pipeline_settings(trial), rows, units, extended, trial.effects_file)
    return {
        ONLINE: online,
        RUN: {"trial": trial.name, "rig": trial.rig.name}
        | ({} if trial.plant is None else {SIMULATED: "true"})
        | ({} if began_at is None else {BEGAN_AT: began_at}),
        SIZES: _sizes(trial.rig.recording),
    }


def _sizes(recording: RecordingConfig) -> dict[str, str]:
    return {
        "part_bytes": str(round(recording.part_MB * 1e6)),
        "part_s": str(recording.part_s),
        "kept_bytes": str(round(recording.kept_MB * 1e6)),
        "kept_parts": str(recording.kept_parts or 0),
    }


@dataclass(frozen=True, slots=True)
class Replayed:
    """The estimators' results, computed from the recorded samples."""

    estimators: list[dict[str, Any]]
    selected: dict[str, Any] | None
    surface_reason: str
    surface: float
    theta: NDArray[np.float64]


def replay_estimators(trial: TrialConfig, slave: Mapping[str, Array]) -> Replayed:
    """Run the recorded samples of the slave through the same kernels as on-line."""
    pipeline = make_pipeline(trial)
    samples = estimated_samples(dict(slave), pipeline.settings, trial.rig.period_ns)
    trace = pipeline.run(samples.position, samples.force, samples.valid)
    rows = report_with_delays(pipeline, trace, trial.rig.units.position, trial.rig.units.force)
    chosen = pipeline.selected
    keys = (*KEYS, "parameters")
    return Replayed(
        estimators=rows,
        selected={key: rows[chosen][key] for key in keys} if chosen >= 0 else None,
        surface_reason=pipeline.surface_reason or "",
        surface=pipeline.contact.surface,
        theta=pipeline.theta.copy(),
    )


def online_metadata(
    settings: PipelineSettings,
    rows: list[RowSpec],
    units: tuple[str, str],
    extended: Mapping[str, Any] | None = None,
    effects_file: str | None = None,
) -> dict[str, str]:
    """Return the metadata by which a replay can repeat the estimators of the run.

    `settings` are those without the extended model, which is stored separately.
    """
    plain = {
        name: value
        for name, value in ((n, getattr(settings, n)) for n in settings.__slots__)
        if isinstance(value, int | float | str)
    }
    names = [row.label for row in rows]
    return {
        "settings": json.dumps(plain),
        "rows": json.dumps(names),
        "position_unit": units[0],
        "force_unit": units[1],
        "extended_model": json.dumps(extended),
        "effects_file": effects_file or "",
    }
