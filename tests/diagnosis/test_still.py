"""Recordings that only hold: rounding errors of a position at rest are no motion."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.recordings.recording import from_arrays

DT_S, SAMPLES = 1e-3, 8000
REST_M = 0.003815  # no sum of powers of two, so sums over a window are rounded


def pressed_and_held() -> np.ndarray:
    """Return a position that moves for half a second, and then rests exactly."""
    t = DT_S * np.arange(SAMPLES)
    return REST_M * 0.5 * (1.0 - np.cos(np.pi * np.minimum(t / 0.5, 1.0)))


def test_velocity_and_acceleration_are_zero_where_the_position_rests() -> None:
    position = pressed_and_held()
    position[600:] = REST_M
    _, v, a = differentiate(position, DT_S, 20)
    assert np.max(v) > 1e-3
    assert not np.any(v[800:])
    assert not np.any(a[800:])


def test_a_force_that_relaxes_at_rest_is_a_relaxation_although_no_damping_is_seen() -> None:
    """Steps of the force as large as its noise must not hide that the fit leaves noise alone."""
    rng = np.random.default_rng(7)
    t = DT_S * np.arange(SAMPLES)
    position = pressed_and_held()
    position[500:] = REST_M
    force = 3000.0 * position + 0.9 * (position / REST_M) * np.exp(-np.maximum(t - 0.5, 0.0) / 3.0)
    force = 0.2 * np.round((force + 0.145 * rng.normal(size=SAMPLES)) / 0.2)
    answer = diagnose(from_arrays("held", t, position, force), "kelvin-voigt").answer
    assert answer["verdict"] in {"named", "class"}
    assert ["stress_relaxation"] in answer["class"]
    assert all(abs(one["value"]) < 1e9 for one in answer["base"]["parameters"].values())
