"""Motion that the window of the derivatives removes, as an error of the encoder's draws."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.noise.encoder import input_errors
from teleop_rt.diagnosis.samples.motion import RecordedMotion, motion_of
from teleop_rt.recordings.recording import from_arrays

DT_S, STEP_M, HALF = 0.001, 2e-6, 40  # a window of 81 ms
_T = DT_S * np.arange(12_000)


def _drawn(shake_m: float) -> tuple[RecordedMotion, list[RecordedMotion], np.ndarray]:
    """Return the motion of a tool that shakes at 40 Hz, its draws, and its true acceleration."""
    shake = shake_m * np.sin(2.0 * np.pi * 40.0 * _T)
    x = 2e-3 * np.sin(2.0 * np.pi * 0.7 * _T) + shake
    a = -2e-3 * (1.4 * np.pi) ** 2 * np.sin(1.4 * np.pi * _T) - (80.0 * np.pi) ** 2 * shake
    position = STEP_M * np.round(x / STEP_M)
    force = 500.0 * x + 0.01 * np.random.default_rng(1).standard_normal(_T.size)
    recording = from_arrays("made", _T, position, force)
    motion = motion_of(recording.position, recording.force, DT_S, 0.0, HALF)
    return motion, input_errors(motion, recording), a


def test_the_draws_err_by_as_much_as_a_window_that_removes_motion() -> None:
    motion, draws, true = _drawn(2e-5)
    inner = slice(3 * HALF, -3 * HALF)
    missed = float(np.std((motion.a - true)[inner]))
    assert missed > 0.6  # m/s^2 of the 0.9 of the shaking: the window removes most of it
    drawn = float(np.mean([np.std((one.a - motion.a)[inner]) for one in draws]))
    assert 0.7 * missed < drawn < 1.4 * missed


def test_a_motion_within_the_band_loses_nothing() -> None:
    motion, draws, true = _drawn(0.0)
    inner = slice(3 * HALF, -3 * HALF)
    missed = float(np.std((motion.a - true)[inner]))
    drawn = float(np.mean([np.std((one.a - motion.a)[inner]) for one in draws]))
    assert drawn < 3.0 * missed < 0.02
