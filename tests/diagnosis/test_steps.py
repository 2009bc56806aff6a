"""Steps of encoder and converter are told from effects: they are the same again at every rest."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt

from teleop_rt.diagnosis.converter import without_steps
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recording import from_arrays

Array = NDArray[np.float64]


def trapezoids(speed: float, levels: Array, dt: float) -> Array:
    """Return a path at constant speed from level to level, with rests of 0.3 s."""
    rest = np.zeros(round(0.3 / dt))
    moves = [np.full(round(abs(d) / speed / dt), np.sign(d) * speed) for d in np.diff(levels)]
    pieces = [row for move in moves for row in (rest, move)]
    path = levels[0] + np.cumsum(np.concatenate([*pieces, rest])) * dt
    smooth: Array = filtfilt(*butter(2, 12.0, fs=1.0 / dt), path)
    return smooth


def test_steps_that_beat_with_the_samples_are_no_effect() -> None:
    """At about a step per sample the errors are slow, and nothing of a smoothed path shows that."""
    dt, step = 1e-3, 8e-6
    rng = np.random.default_rng(0)
    levels = [-3.0, 7.085, -1.5, 4.3, -1.5, 7.085, -1.5, 2.9, -1.5, 5.7, -1.5, 7.085, -1.5]
    path = trapezoids(8.3e-3, 1e-3 * np.array(levels), dt) + rng.uniform(0.0, step)
    force = np.where(path > 0.0, 1622.0 * path + 15.0 * np.gradient(path, dt), 0.0)
    force += 0.03 * rng.standard_normal(path.size)
    read = step * np.round(path / step)
    answer = diagnose(
        from_arrays("beat", dt * np.arange(path.size), read, force), surface=0.0
    ).answer
    assert answer["verdict"] == "no_missing_effect"


@pytest.mark.parametrize("steps", [2.0, 3.0])
def test_a_converter_as_coarse_as_the_noise_makes_no_force(steps: float) -> None:
    rng = np.random.default_rng(4)
    levels = np.repeat(rng.uniform(5.0, 20.0, 12), 1000)
    noise = 0.1
    step = steps * noise
    read = step * np.round((levels + noise * rng.standard_normal(levels.size)) / step)
    means, raw = (
        np.mean((row - levels).reshape(12, -1)[:, 100:-100], axis=1)
        for row in (without_steps(read, 20), read)
    )
    chance = np.hypot(noise, step / np.sqrt(12.0)) / np.sqrt(800.0)
    assert np.sqrt(np.mean(means**2)) < 1.5 * chance
    assert np.sqrt(np.mean(means**2)) < max(0.6 * np.sqrt(np.mean(raw**2)), 1.2 * chance)


def test_a_force_without_steps_or_with_fine_ones_is_left_as_it_is() -> None:
    rng = np.random.default_rng(5)
    force = 10.0 + rng.standard_normal(3000)
    for read in (force, 0.1 * np.round(force / 0.1)):
        np.testing.assert_array_equal(without_steps(read, 20), read)


@pytest.mark.parametrize("seed", [2, 3])
def test_rests_read_by_a_coarse_converter_are_no_ripple(seed: int) -> None:
    dt, noise = 5e-4, 0.12
    rng = np.random.default_rng(seed)
    levels = np.concatenate(([0.6], rng.uniform(0.7, 2.8, 24), [0.7]))
    path = trapezoids(6e-3, 1e-3 * levels, dt)
    force = 33_000.0 * path**1.2 * (1.0 + 2.0 * np.gradient(path, dt))
    force += noise * rng.standard_normal(path.size)
    read = 3.3 * noise * np.round(force / (3.3 * noise))
    recording = from_arrays("converter", dt * np.arange(path.size), path, read)
    answer = diagnose(recording, "hunt-crossley", surface=0.0).answer
    assert answer["verdict"] == "no_missing_effect"
