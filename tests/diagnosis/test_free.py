"""Recordings of a drive that touches nothing, of one that does, and of one that counts the way."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, NOISE_N, STEP_M = 0.002, 0.03, 5e-7
_T = DT_S * np.arange(5000)
Row = NDArray[np.float64]


def _moved(seed: int, size_m: float) -> tuple[Row, Row, Row]:
    """Return position, velocity and acceleration of a motion of five tones."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi * np.array([0.3, 0.7, 1.3, 2.1, 3.4]) * rng.uniform(0.9, 1.1, 5)
    sizes = size_m * np.array([1.0, 0.6, 0.4, 0.2, 0.1]) / 2.3
    phases = rng.uniform(0.0, 2.0 * np.pi, 5)
    turns = np.outer(rates, _T) + phases[:, None]
    x = sizes @ np.sin(turns)
    return x, (sizes * rates) @ np.cos(turns), -(sizes * rates**2) @ np.sin(turns)


def _recorded(x: Row, force: Row, seed: int) -> Recording:
    noise = NOISE_N * np.random.default_rng(1000 + seed).standard_normal(_T.size)
    return from_arrays("made", _T, STEP_M * np.round(x / STEP_M), force + noise)


def _touched(x: Row, v: Row, a: Row, mass_kg: float = 0.0) -> Row:
    """Return the force of a spring and damper beyond 4 mm and of the tool's mass and friction."""
    depth = x - 4e-3
    body = np.where(depth > 0.0, np.maximum(1500.0 * depth + 6.0 * v, 0.0), 0.0)
    return np.asarray(body + mass_kg * a + 0.8 * np.tanh(v / 1e-3))


@pytest.mark.parametrize("seed", cases(1, 2, 3))
def test_a_slide_that_touches_nothing_is_diagnosed_beside_its_mass(seed: int) -> None:
    x, v, a = _moved(seed, 0.08)
    force = 3.0 * a + 12.0 * v + 1.5 * np.tanh(v / 0.01)
    answer = diagnose(_recorded(x, force, seed)).answer
    found = answer["base"]["parameters"]
    assert list(answer["probability"]) == ["coulomb_friction"]
    assert answer["verdict"] == "named"
    assert found["m"]["value"] == pytest.approx(3.0, rel=0.01)
    assert found["c"]["value"] == pytest.approx(12.0, rel=0.01)
    assert any("moves freely" in note for note in answer["notes"])


def test_a_lever_with_gravity_is_no_body_with_a_surface() -> None:
    angle, rate, acceleration = _moved(4, 1.2)
    torque = 0.5 * acceleration + 3.0 * rate + 12.0 * np.sin(angle) + 1.5 * np.tanh(rate / 0.02)
    answer = diagnose(_recorded(angle, torque, 4)).answer
    assert {"gravity_torque", "coulomb_friction"} == set(answer["probability"])


def test_a_spring_beside_the_mass_of_a_free_slide_is_its_own() -> None:
    x, v, a = _moved(5, 0.08)
    force = 2.0 * a + 40.0 * x + 4.0 * v - 2.0 + 1.2 * np.tanh(v / 2e-3)
    answer = diagnose(_recorded(x, force, 5)).answer
    assert list(answer["probability"]) == ["coulomb_friction"]
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(40.0, rel=0.02)


@pytest.mark.parametrize("seed", cases(6, 7, 8))
def test_a_body_touched_by_a_drive_stated_as_free_is_found(seed: int) -> None:
    x, v, a = _moved(seed, 0.01)
    answer = diagnose(_recorded(x, _touched(x, v, a), seed), "mass-damper").answer
    assert list(answer["probability"]) == ["coulomb_friction"]
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(1500.0, rel=0.01)
    assert answer["base"]["parameters"]["surface"]["value"] == pytest.approx(4e-3, abs=1e-5)


def test_a_touched_body_moved_by_a_heavy_tool_stays_touched() -> None:
    x, v, a = _moved(9, 0.01)
    answer = diagnose(_recorded(x, _touched(x, v, a, mass_kg=2.0), 9)).answer
    assert {"coulomb_friction", "tool_inertia"} == set(answer["probability"])
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(1500.0, rel=0.01)


@pytest.mark.parametrize("offset_m", [0.0, 0.12])
def test_a_position_that_counts_away_from_the_body_is_refused(offset_m: float) -> None:
    x, v, a = _moved(10, 0.01)
    turned = _recorded(offset_m - x, _touched(x, v, a), 10)
    with pytest.raises(RecordingError, match=r"wrong sign.*position=-NAME"):
        diagnose(turned)
