"""Bodies that lack three or four effects at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray

from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.recordings.recording import Recording, from_arrays

DT_S, NOISE_N, STEP_M = 0.002, 0.03, 5e-7
_T = DT_S * np.arange(6000)
Row = NDArray[np.float64]


def _moved(seed: int) -> tuple[Row, Row, Row]:
    """Return depth [m], velocity and acceleration of presses with free air between them."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi * np.array([0.31, 0.83, 1.9, 3.3]) * rng.uniform(0.93, 1.07, 4)
    sizes = np.array([1.6e-3, 0.9e-3, 0.3e-3, 0.1e-3])
    turns = np.outer(rates, _T) + rng.uniform(0.0, 2.0 * np.pi, 4)[:, None]
    x = 6e-4 + sizes @ np.sin(turns)
    return x, (sizes * rates) @ np.cos(turns), -(sizes * rates**2) @ np.sin(turns)


def _body(x: Row, v: Row) -> Row:
    """Return the force [N] of a spring and damper in contact."""
    return np.where(x > 0.0, 6000.0 * x + 40.0 * v, 0.0)


def _late(force: Row, seconds: float) -> Row:
    return np.interp(_T - seconds, _T, force)


def _recorded(x: Row, force: Row, seed: int) -> Recording:
    noise = NOISE_N * np.random.default_rng(500 + seed).standard_normal(_T.size)
    return from_arrays("made", _T, STEP_M * np.round(x / STEP_M), force + noise)


def _answer(x: Row, force: Row, seed: int) -> dict[str, Any]:
    return diagnose(_recorded(x, force, seed), surface=0.0).answer


@pytest.mark.parametrize("seed", cases(1, 2, 3))
def test_three_effects_are_named_with_their_sizes(seed: int) -> None:
    x, v, a = _moved(seed)
    force = _late(_body(x, v) + 0.7 * a + 0.25 * np.tanh(v / 2e-4), 0.02)
    answer = _answer(x, force, seed)
    names = [sorted(names) for names in answer["class"]]
    assert names == [["channel_delay", "coulomb_friction", "tool_inertia"]]
    found = {name: one["value"] for e in answer["effects"] for name, one in e["parameters"].items()}
    assert found["mass"] == pytest.approx(0.7, rel=0.03)
    assert found["lag"] == pytest.approx(0.02, abs=4e-4)
    assert found["friction_force"] == pytest.approx(0.25, rel=0.05)
    assert answer["error"]["after_over_floor"] < 1.02


@pytest.mark.parametrize("seed", cases(1, 2))
def test_a_force_of_three_effects_is_no_red_noise(seed: int) -> None:
    """A delay, a softening and a bias: beside two of them the third looked like slow noise."""
    x, v, _ = _moved(seed)
    softer = 1.0 - 0.2 * (1.0 - np.exp(-_T / 4.0))
    force = _late(_body(x, v) * softer, 0.03) + 0.15
    answer = _answer(x, force, seed)
    assert {e["name"] for e in answer["effects"]} == {"channel_delay", "softening", "force_bias"}
    span = float(np.ptp(force[x > 0.0]))
    assert answer["error"]["noise_floor"] * span == pytest.approx(NOISE_N, rel=0.15)


def test_a_third_name_is_not_given_to_an_unknown_force() -> None:
    """Two effects and a force that no name describes: a dome that snaps through."""
    x, v, a = _moved(4)
    dome = 0.6 * np.exp(-(((x - 1.5e-3) / 1.5e-4) ** 2)) * np.where(v > 0.0, 1.0, -0.4)
    answer = _answer(x, _body(x, v) + 0.7 * a + 0.25 * np.tanh(v / 2e-4) + dome, 4)
    assert {e["name"] for e in answer["effects"]} <= {"tool_inertia", "coulomb_friction"}
    assert (
        answer["verdict"] in {"partial", "unexplained"} or answer["error"]["after_over_floor"] > 2
    )


@pytest.mark.parametrize("seed", cases(3, 7, 12))
def test_a_third_name_is_not_given_to_a_part_of_an_unknown_force(seed: int) -> None:
    """A dry friction beside bias and viscous friction took most of a force by place and turn."""
    rng, t = np.random.default_rng(seed), DT_S * np.arange(4000)
    rates = 2.0 * np.pi * np.array([0.4, 0.9, 1.9, 3.3]) * rng.uniform(0.93, 1.07, 4)
    sizes = np.array([0.15, 0.08, 0.03, 0.01])
    turns = np.outer(rates, t) + rng.uniform(0.0, 2.0 * np.pi, 4)[:, None]
    x, v = sizes @ np.sin(turns), (sizes * rates) @ np.cos(turns)
    a = -(sizes * rates**2) @ np.sin(turns)
    unknown = x**2 * np.where(v > 0.0, 1.0, -0.5)
    force = 0.02 * a + 0.3 * v + 1.0 + 0.1 * unknown / np.std(unknown)
    force += 0.005 * np.random.default_rng(seed).standard_normal(t.size)
    tried = {"force_bias", "viscous_friction", "coulomb_friction"}
    effects = tuple(effect for effect in LIBRARY if effect.name in tried)
    answer = diagnose(from_arrays("drive", t, x, force), "mass", effects=effects).answer
    assert {e["name"] for e in answer["effects"]} <= {"force_bias", "viscous_friction"}
    assert max(answer["probability"].values(), default=0.0) <= 0.7


def test_a_tone_a_bias_and_a_friction_are_named_together() -> None:
    x, v, _ = _moved(5)
    force = _body(x, v) + 0.2 * np.sin(2.0 * np.pi * 7.3 * _T) + 0.15 + 30.0 * v
    names = {e["name"] for e in _answer(x, force, 5)["effects"]}
    assert names == {"periodic_disturbance", "force_bias", "viscous_friction"}


def test_a_set_that_leaves_a_chirp_is_less_probable() -> None:
    """A motor that runs up, beside an inertia and a friction, has the spectrum of noise."""
    x, v, a = _moved(6)
    chirp = 0.09 * np.sin(2.0 * np.pi * (3.0 * _T + 2.5 * _T**2))
    answer = _answer(x, _body(x, v) + 0.7 * a + 0.25 * np.tanh(v / 2e-4) + chirp, 6)
    assert {e["name"] for e in answer["effects"]} == {"tool_inertia", "coulomb_friction"}
    assert max(answer["probability"].values()) <= 0.7
    assert any("beside the named effects" in note for note in answer["notes"])
