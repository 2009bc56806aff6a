"""Estimators under noise: estimator x force noise x encoder step x lag of the force.

The rows are those that run on-line, with filters, gates and scaling; the surface is known.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from teleop_rt.estimation.bank import Bank
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import report
from teleop_rt.estimation.rows import rows_for
from teleop_rt.study.chapter4_plant import RATE_HZ, TRUTH, SensorErrors, Sine, plant_force

_FINEST_M, _QUIETEST_N = 1e-7, 1e-4
"""Least resolution and noise that the settings state: an ideal sensor would make weights of 0."""


def cases(
    noises_N: Sequence[float] = (0.0, 0.01, 0.05, 0.2),
    resolutions_m: Sequence[float] = (1e-6, 5e-6, 5e-5),
    lags_ms: Sequence[float] = (0.0, 0.5, 1.0, 2.0),
    seeds: Sequence[int] = (1, 2, 3),
    duration_s: float = 8.0,
) -> list[dict[str, Any]]:
    """Return every case; all estimators share one."""
    return [
        {"model": model, "noise_N": noise, "resolution_m": resolution, "lag_ms": lag,
         "seed": seed, "duration_s": duration_s}
        for model, noise, resolution, lag, seed in itertools.product(
            TRUTH, noises_N, resolutions_m, lags_ms, seeds
        )
    ]  # fmt: skip


def settings_for(noise: float, resolution: float) -> PipelineSettings:
    """Return settings that know the sensors [N, m] and the surface, not the lag."""
    known = max(noise, _QUIETEST_N)
    return PipelineSettings(
        period_s=1.0 / RATE_HZ,
        position_resolution=max(resolution, _FINEST_M),
        force_noise=known,
        onset_force=8.0 * known,
        release_force=4.0 * known,
        surface=0.0,
    )


def evaluate(case: dict[str, Any]) -> dict[str, Any]:
    """Return relative errors of the parameters, status and NRMSE of every row of the model."""
    model, truth = case["model"], TRUTH[case["model"]]
    sensors = SensorErrors(case["noise_N"], case["resolution_m"], 1e-3 * case["lag_ms"])
    profile = Sine(duration_s=case["duration_s"])
    position, measured = sensors.record(profile, model, truth, case["seed"])
    pipeline = Pipeline(rows_for([model]), settings_for(case["noise_N"], case["resolution_m"]))
    pipeline.run(position, measured, np.ones(position.size, dtype=np.bool_))
    return case | {"methods": [_result(row, truth) for row in report(pipeline)]}


def _result(row: dict[str, Any], truth: dict[str, float]) -> dict[str, Any]:
    """Return one row's answer; an error is null where nothing is estimated."""
    found = {name: row["parameters"][name]["value"] for name in truth}
    return {key: row[key] for key in ("regression", "solver", "status", "nrmse")} | {
        "error": {
            name: None if value is None else value / truth[name] - 1.0
            for name, value in found.items()
        }
    }


def hidden_damping(
    sigma_N: float = 0.05, seeds: int = 8, duration_s: float = 10.0
) -> dict[str, Any]:
    """Return b by the integral criterion for Hunt-Crossley at 5 mm +- 2 mm under noise.

    Least squares on [1, v, ln x], weighted by f^2, at 3 Hz: `exact` without noise, `low` and
    `high` over the seeds; `ratio` is the largest |b v / k|.
    """
    truth = TRUTH["hunt-crossley"]
    motion = Sine(3.0, 0.005, 0.002, duration_s).samples()
    clean = plant_force("hunt-crossley", truth, motion)
    phi = np.column_stack([np.ones_like(clean), motion.v, np.log(motion.x / 5e-3)]) * clean[:, None]

    def damping(measured: np.ndarray[Any, np.dtype[np.float64]]) -> float:
        bank = Bank(["iec"], [3])
        bank.run(phi[:, None, :], (np.log(measured) * clean)[:, None])
        log_k, ratio, n = bank.theta[0, :3]
        return float(np.exp(log_k - n * np.log(5e-3)) * ratio)

    noises = [np.random.default_rng(seed).normal(size=clean.size) for seed in range(seeds)]
    found = [damping(np.maximum(clean + sigma_N * one, 0.01)) for one in noises]
    return {
        "sigma_N": sigma_N, "seeds": seeds, "exact": damping(clean),
        "low": min(found), "high": max(found),
        "ratio": float(np.max(np.abs(motion.v)) * truth["b"] / truth["k"]),
    }  # fmt: skip
