"""Coarse samples, between which the course of the tool is not recorded."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.models.simulate import over_steps
from teleop_rt.recordings.recording import Recording, from_arrays
from teleop_rt_dev.diagnosis.foreign_plants import foreign


def _steps(seed: int, dt_s: float, samples: int) -> np.ndarray:
    """Return quick steps between places, as positions that a body may be pressed to [m]."""
    rng = np.random.default_rng(seed)
    t, x, at = dt_s * np.arange(samples), np.zeros(samples), 0.4
    while at < t[-1] - 1.0:
        u = np.clip((t - at) / rng.uniform(0.12, 0.25), 0.0, 1.0)
        x += rng.uniform(-3e-3, 3e-3) * (10.0 * u**3 - 15.0 * u**4 + 6.0 * u**5)
        at += rng.uniform(0.3, 0.8)
    return np.asarray(x)


def _recorded(seed: int, dt_s: float) -> Recording:
    """Return a linear damped spring whose damper follows the differences of coarse samples."""
    samples = round(12.0 / dt_s)
    x = _steps(seed, dt_s, samples)
    force = 5600.0 * x + 240.0 * np.gradient(x, dt_s)
    rng = np.random.default_rng(100 + seed)
    force += 2.5e-3 * np.std(force) * rng.standard_normal(samples)
    return from_arrays("made", dt_s * np.arange(samples), 1e-6 * np.round(x / 1e-6), force)


@pytest.mark.parametrize("seed", cases(1, 2, 3, 4))
def test_a_velocity_by_differences_is_no_effect(seed: int) -> None:
    answer = diagnose(_recorded(seed, 0.01), "spring,viscous,bias").answer
    assert answer["verdict"] == "no_missing_effect"


def test_a_surface_between_two_samples_leaves_nothing_for_a_surface_that_moves() -> None:
    """Presses of a hand in red noise: from the wrong gap, a moving surface was named."""
    record = foreign(1597303996)
    recording = from_arrays("hand", record.t, record.position, record.force, units=record.units)
    assert diagnose(recording, record.base).answer["verdict"] == "no_missing_effect"


def test_a_memory_advances_by_the_velocity_midway_between_samples() -> None:
    """The mean of two velocities is too small by 3 % at twelve samples per period."""
    turn = 2.0 * np.pi / 12.0
    at_samples = np.cos(turn * np.arange(60))
    midway = np.cos(turn * (np.arange(60) - 0.5))
    np.testing.assert_allclose(over_steps(at_samples)[2:-1], midway[2:-1], atol=3e-3)
