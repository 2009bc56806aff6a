"""A spring that slips at one force, as in a clutch."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, NOISE_N, STEP_M = 0.002, 0.03, 1e-6
_T = DT_S * np.arange(5000)
Row = NDArray[np.float64]


def _moved(seed: int, size_m: float) -> tuple[Row, Row]:
    """Return position and velocity of a motion of four tones."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi * np.array([0.4, 0.9, 1.7, 3.1]) * rng.uniform(0.9, 1.1, 4)
    sizes = size_m * np.array([1.0, 0.6, 0.4, 0.2]) / 2.2
    turns = np.outer(rates, _T) + rng.uniform(0.0, 2.0 * np.pi, 4)[:, None]
    return sizes @ np.sin(turns), (sizes * rates) @ np.cos(turns)


def _slipped(x: Row, travel_m: float) -> Row:
    """Return the stretch [m] of a spring that slips at its travel, from rest at the beginning."""
    found, stretch = np.zeros(x.size), 0.0
    for i in range(1, x.size):
        stretch = float(np.clip(stretch + x[i] - x[i - 1], -travel_m, travel_m))
        found[i] = stretch
    return found


def _recorded(x: Row, force: Row, seed: int) -> Recording:
    noise = NOISE_N * np.random.default_rng(1000 + seed).standard_normal(_T.size)
    return from_arrays("made", _T, STEP_M * np.round(x / STEP_M), force + noise)


@pytest.mark.parametrize("seed", cases(1, 2, 3))
@pytest.mark.parametrize("beside_N_per_m", [0.0, 400.0])
def test_a_clutch_slips_at_its_force_and_travel(seed: int, beside_N_per_m: float) -> None:
    x, v = _moved(seed, 0.012)
    force = 1500.0 * _slipped(x, 6e-3) + beside_N_per_m * x + 5.0 * v
    answer = diagnose(_recorded(x, force, seed), "spring,viscous,bias").answer
    assert list(answer["probability"]) == ["hysteresis"]
    found = answer["effects"][0]["parameters"]
    assert found["yield_force"]["value"] == pytest.approx(9.0, rel=0.01)
    assert found["yield_travel"]["value"] == pytest.approx(6e-3, rel=0.01)
    parameters = answer["base"]["parameters"]
    assert parameters["k"]["value"] == pytest.approx(beside_N_per_m, abs=5.0)
    assert parameters["c"]["value"] == pytest.approx(5.0, abs=0.2)
