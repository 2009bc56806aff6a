"""Friction that falls with the speed in another way than by Gauss's curve."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S, NOISE_N = 1e-3, 0.01


@pytest.mark.parametrize("slow_m_per_s", cases(1e-2, 2e-2))
def test_friction_that_falls_slowly_is_stribeck_friction(slow_m_per_s: float) -> None:
    """The curve of Hess and Soom was three effects of a contact that does not exist, at 0.8."""
    t = DT_S * np.arange(12000)
    x = 0.02 * np.sin(1.7 * t) + 8e-3 * np.sin(4.1 * t + 1.0) + 2e-3 * np.sin(11.0 * t)
    v = np.gradient(x, DT_S)
    rubs = np.tanh(v / 5e-4) * (0.6 + 0.8 / (1.0 + (v / slow_m_per_s) ** 2))
    force = 60.0 * x + 8.0 * v + rubs + 0.3
    force += NOISE_N * np.random.default_rng(23).standard_normal(t.size)
    answer = diagnose(
        from_arrays("rack", t, 1e-6 * np.round(x / 1e-6), force), "spring,viscous,bias"
    ).answer
    assert answer["class"] == [["stribeck_friction"]]
    assert answer["error"]["std_normalised"]["after"] < 0.02
