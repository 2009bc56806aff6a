"""A surface that swings and recedes at once is one effect, not two."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays


@pytest.mark.parametrize(("recedes_m_per_s", "seed"), [(-2e-4, 2), *cases((1e-4, 1), (2e-4, 3))])
def test_a_breathing_surface_that_drifts_leaves_stiffness_alone(
    recedes_m_per_s: float, seed: int
) -> None:
    """The drift became a relaxation of 36 s, and k a third of the true one."""
    dt_s = 0.004
    t = dt_s * np.arange(5000)
    x = 0.020 + 5e-3 * np.sin(2.0 * np.pi * 0.9 * t) + 3e-3 * np.sin(2.0 * np.pi * 0.37 * t + 1.0)
    angle = 2.0 * np.pi * 0.3 * t
    depth = x - 0.0137 - recedes_m_per_s * t - 2.5e-3 * np.sin(angle)
    speed = np.gradient(depth, dt_s)
    force = np.where(depth > 0.0, np.maximum(0.0, 3600.0 * depth + 20.0 * speed), 0.0)
    force += 0.05 * np.random.default_rng(seed).standard_normal(t.size)
    answer = diagnose(from_arrays("breath", t, 5e-6 * np.round(x / 5e-6), force)).answer
    assert answer["class"] == [["moving_surface"]]
    found = answer["effects"][0]["parameters"]
    receded = found["swings_receded"]["value"] * found["swing"]["value"]
    assert receded == pytest.approx(recedes_m_per_s, rel=0.05)
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(3600.0, rel=0.01)


@pytest.mark.parametrize("second", [0.4, *cases(2.0)])
def test_a_beating_surface_is_one_effect_whichever_harmonic_is_the_strongest(second: float) -> None:
    """The harmonics were a periodic force beside it, and four times the noise was left."""
    dt_s = 0.004
    t = dt_s * np.arange(5000)
    x = 0.016 + 4e-3 * np.sin(2.0 * np.pi * 0.63 * t) + 3e-3 * np.sin(2.0 * np.pi * 0.27 * t + 1.0)
    beat = 2.0 * np.pi * 1.1 * t
    pulse = np.sin(beat) + second * np.sin(2.0 * beat + 1.0) + 0.2 * np.sin(3.0 * beat + 2.0)
    depth = x - 0.0115 - 4e-4 * pulse
    force = np.maximum(900.0 * depth + 8.0 * np.gradient(depth, dt_s), 0.0) * (depth > 0.0)
    force += 0.02 * np.random.default_rng(4).standard_normal(t.size)
    answer = diagnose(from_arrays("heart", t, 1e-6 * np.round(x / 1e-6), force)).answer
    assert answer["class"] == [["moving_surface"]]
    assert answer["error"]["after_over_floor"] < 1.1
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(900.0, rel=0.01)
