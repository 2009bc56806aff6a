"""The true environment's force for any motion: the reference of the felt force."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from teleop_rt_drivers.simulated import hidden
from teleop_rt_drivers.simulated.hidden_config import HiddenEffectConfig
from teleop_rt_drivers.simulated.hidden_motion import force_along

Array = NDArray[np.float64]
_STEP_S = 5e-5
"""Largest step of the integration, that of the simulated plant."""
_EFFECTS: TypeAdapter[tuple[HiddenEffectConfig, ...]] = TypeAdapter(tuple[HiddenEffectConfig, ...])


def environment_force(
    truth: Mapping[str, Any], position: Array, velocity: Array, period_s: float
) -> Array:
    """Return the force (n,) of a plant's environment along positions and velocities (n,).

    `truth` is the content of truth.json; rig units, axis coordinates. Of hidden effects
    only the environment's own count, for a tip that is led along the positions from the plant's
    start; gaps are bridged by the last position.
    """
    body, undeclared = truth["environment"], truth.get("undeclared", ())
    power = body.get("hunt_crossley")
    if not undeclared and power is None:
        depth = position - body["surface"]
        force = np.maximum(0.0, body["stiffness"] * depth + body["damping"] * velocity)
        return np.where(depth >= 0.0, force, 0.0)
    constants = np.zeros(hidden.N_CONSTANTS)
    constants[[hidden.STIFFNESS, hidden.DAMPING, hidden.SURFACE]] = (
        body["stiffness"], body["damping"], body["surface"],
    )  # fmt: skip
    if power is not None:
        constants[[hidden.EXPONENT, hidden.EXPONENT_DEPTH]] = power["exponent"], power["depth"]
    for effect in _EFFECTS.validate_python(_as_in_yaml(undeclared)):
        for column, value in effect.constants().items():
            constants[column] = value
    known = np.isfinite(position)
    led = np.interp(np.arange(position.size), np.flatnonzero(known), position[known])
    force = force_along(led, period_s, constants, max(1, round(period_s / _STEP_S)))
    return np.where(known, force, np.nan)


def _as_in_yaml(plain: Any) -> Any:
    """Return a value from JSON with its lists as tuples, as a config's are."""
    if isinstance(plain, dict):
        return {key: _as_in_yaml(value) for key, value in plain.items()}
    if isinstance(plain, list):
        return tuple(_as_in_yaml(item) for item in plain)
    return plain
