"""The window of the derivatives follows the motion's spectrum and the encoder's noise."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.samples.motion import differentiate
from teleop_rt.diagnosis.samples.preparation import problem_of
from teleop_rt.diagnosis.samples.smoothing import half_window
from teleop_rt.recordings.recording import from_arrays

_AMPLITUDE_M = 0.02


def _stroke(rate_hz: float, motion_hz: float, seconds: float) -> tuple[Vector, Vector]:
    """Return time and a smooth stroke."""
    t = np.arange(round(rate_hz * seconds)) / rate_hz
    return t, _AMPLITUDE_M * np.sin(2.0 * np.pi * motion_hz * t)


def _speed_error(position: Vector, true_speed: Vector, dt: float, half: int) -> float:
    """Return the root mean square error of the velocity over the true one's deviation."""
    _, v, _ = differentiate(position, dt, half)
    inside = slice(2 * half, -2 * half)
    return float(np.sqrt(np.mean((v - true_speed)[inside] ** 2)) / np.std(true_speed))


def _noisy(position: Vector, deviation_m: float) -> Vector:
    return position + deviation_m * np.random.default_rng(3).standard_normal(position.size)


@pytest.mark.parametrize("rate_hz", [100.0, 500.0])
def test_a_slow_motion_with_a_noisy_encoder_is_smoothed_over_tenths_of_a_second(
    rate_hz: float,
) -> None:
    t, x = _stroke(rate_hz, 0.2, 40.0)
    speed = np.gradient(x, t)
    read = _noisy(x, 1e-4)
    half = half_window(read, 1.0 / rate_hz)
    assert 0.05 <= half / rate_hz <= 0.31
    at_20_ms = max(3, round(0.02 * rate_hz))
    assert _speed_error(read, speed, 1.0 / rate_hz, half) < 0.3 * _speed_error(
        read, speed, 1.0 / rate_hz, at_20_ms
    )


def test_the_window_is_near_the_best_of_all_windows() -> None:
    rate_hz = 200.0
    rng = np.random.default_rng(8)
    t = np.arange(8000) / rate_hz
    tones = [(0.3, 1.0), (1.1, 0.4), (2.7, 0.15)]
    x = 0.01 * np.sum([a * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f, a in tones], axis=0)
    speed = np.gradient(x, t)
    read = _noisy(x, 5e-5)
    chosen = _speed_error(read, speed, 1.0 / rate_hz, half_window(read, 1.0 / rate_hz))
    errors = [_speed_error(read, speed, 1.0 / rate_hz, half) for half in range(3, 61)]
    assert chosen < 1.5 * min(errors)


def test_noise_of_a_fiftieth_of_the_speed_is_smoothed_away() -> None:
    """Up to 3 % the narrowest window stayed; a stiff damper then felt more noise than its sensor.

    With equal steps of the encoder, and a motion up to 3 Hz that is read at 100 Hz.
    """
    rng = np.random.default_rng(2)
    t = np.arange(2000) / 100.0
    rates = rng.uniform(0.3, 3.0, 24)
    x = 1e-4 * np.sum(np.sin(2 * np.pi * np.outer(rates, t) + rng.uniform(0, 6, (24, 1))), axis=0)
    speed = np.gradient(x, t)
    read = 2e-6 * np.round(x / 2e-6)
    narrow, chosen = (_speed_error(read, speed, 0.01, h) for h in (3, half_window(read, 0.01)))
    assert 0.01 < narrow < 0.03
    assert chosen < 0.7 * narrow


def test_a_model_with_a_mass_is_smoothed_for_the_acceleration() -> None:
    """The window that suits the velocity let an encoder's noise through, as a force of the mass."""
    t, x = _stroke(500.0, 0.7, 20.0)
    acceleration = np.gradient(np.gradient(x, t), t)
    read = _noisy(x, 1e-5)

    def error(half: int) -> float:
        inside = slice(2 * half, -2 * half)
        found = differentiate(read, 1.0 / 500.0, half)[2]
        return float(np.std((found - acceleration)[inside]) / np.std(acceleration))

    narrow, wide = (half_window(read, 1.0 / 500.0, order) for order in (1, 2))
    assert error(wide) < 0.3 * error(narrow)
    problems = [
        problem_of(from_arrays("mass", t, read, acceleration), base_of(base), 0.0)
        for base in ("viscous,bias", "mass")
    ]
    assert [problem.motion.half for problem in problems] == [narrow, wide]


def test_isolated_slips_of_the_encoder_count_as_noise() -> None:
    t, x = _stroke(100.0, 0.2, 60.0)
    read = x.copy()
    slips = np.random.default_rng(5).choice(t.size, t.size // 30, replace=False)
    read[slips] += 5e-4 * np.sign(np.sin(7.0 * slips))
    assert half_window(read, 0.01) >= 10


def test_steps_that_beat_with_a_steady_slow_speed_are_smoothed_away() -> None:
    t = np.arange(20_000) * 1e-3
    x = 0.2 * np.abs((t / 10.0) % 2.0 - 1.0)  # a triangle: 0.02 m/s, 10 steps a second
    speed = np.gradient(x, 1e-3)
    read = 2e-3 * np.round(x / 2e-3)
    half = half_window(read, 1e-3)
    assert _speed_error(read, speed, 1e-3, half) < 0.5 * _speed_error(read, speed, 1e-3, 20)


def test_a_fast_motion_keeps_its_narrow_window() -> None:
    _, x = _stroke(1000.0, 20.0, 10.0)
    assert half_window(_noisy(x, 1e-4), 1e-3) <= 20


def test_a_quiet_encoder_is_smoothed_no_more_than_before() -> None:
    _, x = _stroke(1000.0, 0.5, 10.0)
    assert half_window(_noisy(x, 1e-6), 1e-3) <= 20


def test_an_error_counts_the_bias_that_a_model_leaves() -> None:
    force: NDArray[np.float64] = np.sin(np.linspace(0.0, 20.0, 1000))
    found = held_out.error(force, force - 0.5, np.ones(1000))
    assert found.std_normalised == pytest.approx(0.5 / np.std(force))
