"""Hysteresis by Bouc and Wen: it unloads by any curve, and forgets where the tool has left."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import from_arrays

DT, YIELD_N, TRAVEL_M, NOISE_N = 2e-3, 2.0, 6e-4, 0.03


def bouc_wen(x: NDArray[np.float64], beta: float, gamma: float) -> NDArray[np.float64]:
    """Return z of dz/dx = (1 - |z| (gamma + beta sgn(z dx)))/d, 0 out of contact."""
    fine, found, z = 20, np.zeros(x.size), 0.0
    for i in range(1, x.size):
        if x[i] <= 0.0:
            z = 0.0
            continue
        step = (x[i] - max(x[i - 1], 0.0)) / TRAVEL_M / fine
        for _ in range(fine):
            z += step * (1.0 - abs(z) * (gamma + beta * np.sign(z * step)))
        found[i] = z
    return found


@pytest.mark.parametrize("beta", cases(0.4, 0.6, 0.85))
def test_hysteresis_is_named_however_it_unloads(beta: float) -> None:
    t = np.arange(0.0, 16.0, DT)
    x = 2e-3 + 3e-3 * np.sin(2 * np.pi * 0.43 * t - 1.0) + 8e-4 * np.sin(2 * np.pi * 1.7 * t)
    force = np.where(x > 0.0, 3000.0 * x, 0.0) + YIELD_N * bouc_wen(x, beta, 1.0 - beta)
    force += NOISE_N * np.random.default_rng(2).standard_normal(t.size)
    read = 1e-6 * np.round(x / 1e-6)
    answer = diagnose(from_arrays("from zero", t, read, force), "spring,viscous").answer
    assert answer["class"] == [["hysteresis"]]
    assert answer["error"]["after_over_floor"] < 1.1
    parameters = answer["effects"][0]["parameters"]
    assert parameters["unloading"]["value"] == pytest.approx(2.0 * beta - 1.0, abs=0.05)
    assert parameters["yield_force"]["value"] == pytest.approx(YIELD_N, rel=0.03)
