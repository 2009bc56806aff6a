"""A gel whose structure breaks as the tool works in it, and heals at rest."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S, NOISE_N = 4e-3, 0.02


@pytest.mark.parametrize("healing_s", cases(2.5, 1.5))
def test_a_gel_that_heals_at_rest_softens(healing_s: float) -> None:
    """Its stiffness follows neither time nor load: it was unexplained."""
    t = DT_S * np.arange(6000)
    works = (np.sin(2 * np.pi * t / 8.0) > -0.3).astype(float)
    works = np.convolve(works, np.hanning(100) / np.hanning(100).sum(), "same")
    x = 2.5e-3 + works * (1.8e-3 * np.sin(9.0 * t) + 1.2e-3 * np.sin(4.1 * t + 1.0))
    x += 2.2e-3 * np.sin(0.8 * t + 2.0)
    v, intact = np.gradient(x, DT_S), np.ones_like(x)
    for i in range(1, t.size):
        broken = abs(v[i]) / 0.02 * intact[i - 1] if x[i] > 0.0 else 0.0
        intact[i] = intact[i - 1] + DT_S * ((1.0 - intact[i - 1]) / healing_s - broken)
    force = (400.0 + 700.0 * intact) * x + 6.0 * v
    force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    force += NOISE_N * np.random.default_rng(5).standard_normal(t.size)
    answer = diagnose(from_arrays("gel", t, 1e-6 * np.round(x / 1e-6) + 0.01, force)).answer
    assert answer["class"] == [["softening"]]
    found = answer["effects"][0]["parameters"]["healing_time"]["value"]
    assert found == pytest.approx(healing_s, rel=0.1)
    assert answer["error"]["after_over_floor"] < 1.1
