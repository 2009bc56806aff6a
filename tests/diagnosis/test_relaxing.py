"""Stretched rubber: its force relaxes over decades of time, and its tangent falls with depth."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.recordings.recording import from_arrays

_RATE_HZ = 50.0
_RELAXES = {"stress_relaxation", "fractional_relaxation"}


def _strip(t: Vector, x: Vector) -> Vector:
    """Return the force of a neo-Hookean strip by its convolution integral; it slackens, not pushes.

    It relaxes with the logarithm of time, as none of the declared laws does.
    """
    stretch = 1.0 + np.maximum(x, 0.0) / 0.04
    elastic = stretch - stretch**-2
    left = 1.0 / (1.0 + 0.35 * np.log1p(t / 0.05))
    force = np.convolve(np.diff(elastic, prepend=0.0), left)[: t.size]
    return np.maximum(force, 0.0)


def test_a_strip_that_slackens_is_relaxation_and_no_saturated_sensor() -> None:
    t = np.arange(800) / _RATE_HZ
    x = 0.08 * (1.0 - np.abs(2.0 * t / t[-1] - 1.0))
    rng = np.random.default_rng(3)
    force = _strip(t, x) + 2e-3 * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("strip", t, x + 2e-7 * rng.standard_normal(t.size), force)).answer
    assert answer["class"]
    assert all(_RELAXES & set(names) for names in answer["class"])
    error = answer["error"]["std_normalised"]
    assert error["after"] < 0.2 * error["before"]
