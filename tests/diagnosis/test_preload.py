"""A body that pushes at once when it is touched: a plunger on its collar, a hooked spring."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT_S, STIFFNESS, DAMPING, NOISE_N = 2e-3, 700.0, 6.0, 0.02


def answer(preload_N: float, within_m: float) -> dict:
    """Return the answer for a body that pushes with its preload `within_m` of its surface."""
    t = DT_S * np.arange(7000)
    x = 1e-3 + 4e-3 * np.sin(2.1 * t) + 2e-3 * np.sin(5.3 * t + 1.0) + 5e-4 * np.sin(13.0 * t)
    force = STIFFNESS * x + DAMPING * np.gradient(x, DT_S)
    force += preload_N * (1.0 - np.exp(-np.maximum(x, 0.0) / within_m))
    force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    force += NOISE_N * np.random.default_rng(17).standard_normal(t.size)
    return diagnose(from_arrays("plunger", t, 1e-6 * np.round(x / 1e-6) + 0.03, force)).answer


@pytest.mark.parametrize("within_m", cases(1e-5, 6e-5))
def test_a_force_that_is_there_at_once_is_a_preload(within_m: float) -> None:
    """A relaxation was named in its place."""
    found = answer(1.5, within_m)
    assert ["preload"] in found["class"]
    assert len(found["class"]) <= 2  # a thin stiff crust pushes alike
    assert found["effects"][0]["parameters"]["preload"]["value"] == pytest.approx(1.5, rel=0.05)
    assert found["error"]["after_over_floor"] < 1.03


def test_a_body_without_a_preload_has_none() -> None:
    assert answer(0.0, 1e-5)["verdict"] == "no_missing_effect"
