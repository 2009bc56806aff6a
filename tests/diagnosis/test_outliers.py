"""Isolated samples: a channel's own faults know nothing of the motion."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.answers.outliers import of_motion
from teleop_rt.diagnosis.samples.motion import RecordedMotion


def moved() -> RecordedMotion:
    t = np.arange(8000) * 1e-3
    w = 2.0 * np.pi * 1.3
    return RecordedMotion(t, np.sin(w * t), w * np.cos(w * t), -w * w * np.sin(w * t), 1e-3)


def test_samples_at_every_reversal_come_with_the_motion_and_scattered_ones_do_not() -> None:
    motion = moved()
    blows = np.zeros(motion.t.size)
    blows[np.flatnonzero(np.diff(np.sign(motion.v))) + 2] = 1.0
    assert of_motion(blows, motion)
    for seed in range(20):
        scattered = (np.random.default_rng(seed).random(motion.t.size) < 0.004).astype(float)
        assert not of_motion(scattered, motion)
