"""The true felt force of a simulated hand: at its own port, against the true environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.metrics import error_of_size, lag_s
from teleop_rt.trial.felt_force import EnvironmentForce, moves

Array = NDArray[np.float64]
LAG_MARGIN_S = 0.5
"""Largest lag [s] that is searched beside the round trip of the link."""


def true_port(
    trial: TrialConfig,
    master: Mapping[str, Array],
    handle: Mapping[str, Array],
    truth: Mapping[str, Any],
    environment_force: EnvironmentForce,
    converged: NDArray[np.bool_],
) -> dict[str, float | None]:
    """Return NRMSE and lag of motor and hand force at the device's true motion.

    `master` and `handle` are the recorded columns, `converged` (n,) the master rows that count.
    The motor's force is the wall's; the hand's has the device's own inertia and
    friction on top, which are there in free air as well.
    """
    stamps, scale = master["stamp_ns"], trial.master.position_scale
    at = {
        name: np.interp(stamps, handle["stamp_ns"], handle[name])
        for name in ("position", "velocity", "motor_force", "hand_force")
    }
    period_s = 1.0 / trial.master.rate_hz
    felt_at = scale * at["position"] - master["offset"]
    true_force = environment_force(truth, felt_at, scale * at["velocity"], period_s)
    moved = moves(trial, true_force[converged])
    result: dict[str, float | None] = {}
    for name in ("motor", "hand"):
        felt = at[f"{name}_force"] / trial.master.force_scale
        counts = converged & ((true_force > 0.0) | (master["rendered_force"] > 0.0))
        lag = (
            lag_s(true_force[converged], felt[converged], period_s, LAG_MARGIN_S) if moved else None
        )
        result[f"{name}_nrmse"] = error_of_size(
            np.where(counts, true_force, np.nan), np.where(counts, felt, np.nan)
        )
        result[f"{name}_lag_ms"] = None if lag is None else 1e3 * lag
    return result
