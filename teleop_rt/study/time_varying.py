"""Tracking delay of each solver for a stiffness that steps or ramps, as on another material."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt.estimation.tracking import tracking_delay
from teleop_rt.study.chapter4_plant import Signal, Sine, plant_force
from teleop_rt.study.noise import settings_for

NOISE_N, RESOLUTION_M, DAMPING = 0.05, 5e-6, 20.0
"""Sensors like those of the simulated rigs, and the body's damping [N s/m]."""
SOFT, STIFF = 1500.0, 3600.0
"""N/m before and after the ramp: the report's body and the silicone cube."""


def cases(
    ramps_s: Sequence[float] = (0.0, 0.5, 2.0),
    forgetting: Sequence[float] = (1.0, 0.998, 0.99),
    frequencies_hz: Sequence[float] = (1.0, 3.0, 10.0),
    seeds: Sequence[int] = (1, 2, 3),
    duration_s: float = 10.0,
) -> list[dict[str, Any]]:
    """Return every case; a ramp of 0 s is a step. All solvers share one."""
    return [
        {"ramp_s": ramp, "forgetting_factor": factor, "frequency_hz": frequency, "seed": seed,
         "duration_s": duration_s}
        for ramp, factor, frequency, seed in itertools.product(
            ramps_s, forgetting, frequencies_hz, seeds
        )
    ]  # fmt: skip


def stiffness(t: Signal, ramp_s: float, duration_s: float) -> Signal:
    """Return k (n,) [N/m]: soft, then from 0.4 of the duration on to stiff within `ramp_s`."""
    since = t - 0.4 * duration_s
    share = np.clip(since / ramp_s, 0.0, 1.0) if ramp_s > 0.0 else (since >= 0.0).astype(float)
    k: Signal = SOFT + (STIFF - SOFT) * share
    return k


def evaluate(case: dict[str, Any]) -> dict[str, Any]:
    """Return delay [s] and errors of k by every Kelvin-Voigt row.

    `delay_s` is null where a row does not follow; `error_before` and `error_after` are relative,
    just before the change and at the end.
    """
    motion = Sine(case["frequency_hz"], duration_s=case["duration_s"]).samples()
    k = stiffness(motion.t, case["ramp_s"], case["duration_s"])
    noise = np.random.default_rng(case["seed"]).normal(size=k.size)
    measured = plant_force("kelvin-voigt", {"k": k, "b": DAMPING}, motion) + NOISE_N * noise
    position = np.round(motion.x / RESOLUTION_M) * RESOLUTION_M
    settings = replace(
        settings_for(NOISE_N, RESOLUTION_M), forgetting_factor=case["forgetting_factor"]
    )
    pipeline = Pipeline(rows_for(["kelvin-voigt"]), settings)
    trace = pipeline.run(position, measured, np.ones(k.size, dtype=np.bool_))
    # The start from nothing is no change that a row could follow.
    begin, change = round(0.2 * k.size), round(0.4 * k.size)
    methods = []
    for row, spec in enumerate(pipeline.rows):
        found = trace.physical(row, "k")
        methods.append(
            {
                "regression": spec.regression,
                "solver": spec.solver,
                "delay_s": tracking_delay(motion.t[begin:], found[begin:], k[begin:]),
                "error_before": float(found[change - 1] / k[change - 1] - 1.0),
                "error_after": float(found[-1] / k[-1] - 1.0),
            }
        )
    return case | {"methods": methods}
