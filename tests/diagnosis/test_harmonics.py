"""A tone with harmonics on the force, as of a pump or a fan."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S, NOISE_N = 2e-3, 0.02


@pytest.mark.parametrize("hertz", cases(4.37, 9.1))
def test_a_pump_is_one_disturbance_with_its_harmonics(hertz: float) -> None:
    """Its harmonics were named a swinging surface, a partner of the tone, at 0.97."""
    t = DT_S * np.arange(7000)
    x = 1e-3 + 4e-3 * np.sin(2.1 * t) + 2e-3 * np.sin(5.3 * t + 1.0)
    force = 600.0 * x + 7.0 * np.gradient(x, DT_S)
    force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    force += 0.8 * (np.abs(np.sin(np.pi * hertz * t + 0.6)) - 2.0 / np.pi)
    force += NOISE_N * np.random.default_rng(29).standard_normal(t.size)
    answer = diagnose(from_arrays("pump", t, 1e-6 * np.round(x / 1e-6) + 0.02, force)).answer
    assert answer["class"] == [["periodic_disturbance"]]
    frequency = answer["effects"][0]["parameters"]["frequency"]["value"]
    assert frequency == pytest.approx(hertz, abs=0.01)
    assert answer["error"]["after_over_floor"] < 1.2  # a fourth harmonic is left
