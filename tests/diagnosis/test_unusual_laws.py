"""Effects whose law differs from that of the textbook: the name is the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from cases import cases
from numpy.typing import NDArray
from scipy.optimize import brentq

from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.models.in_series import Joint, SpringDamper, press_in_series
from teleop_rt.recordings.recording import from_arrays

DT_S, NOISE_N, STEP_M = 0.002, 0.02, 5e-7
STIFFNESS, DAMPING = 6000.0, 40.0
_T = DT_S * np.arange(5000)
Row = NDArray[np.float64]


def _moved(seed: int) -> tuple[Row, Row]:
    """Return depth [m] and velocity of presses with free air between them."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi * np.array([0.31, 0.83, 1.9]) * rng.uniform(0.93, 1.07, 3)
    sizes = np.array([1.6e-3, 0.9e-3, 0.3e-3])
    turns = np.outer(rates, _T) + rng.uniform(0.0, 2.0 * np.pi, 3)[:, None]
    return 6e-4 + sizes @ np.sin(turns), (sizes * rates) @ np.cos(turns)


def _body(x: Row, v: Row) -> Row:
    return np.where(x > 0.0, STIFFNESS * x + DAMPING * v, 0.0)


def _answer(x: Row, force: Row, seed: int) -> dict[str, Any]:
    noise = NOISE_N * np.random.default_rng(700 + seed).standard_normal(_T.size)
    recording = from_arrays("made", _T, STEP_M * np.round(x / STEP_M), force + noise)
    return diagnose(recording, surface=0.0).answer


def _sets(answer: dict[str, Any]) -> set[frozenset[str]]:
    return {frozenset(names) for names in answer["class"]}


@pytest.mark.parametrize("seed", cases(1, 2))
def test_a_surface_that_sinks_and_settles_is_a_moving_surface(seed: int) -> None:
    x, v = _moved(seed)
    sunk, rate = 3e-4 * (1.0 - np.exp(-_T / 2.5)), 3e-4 / 2.5 * np.exp(-_T / 2.5)
    answer = _answer(x, _body(x - sunk, v - rate), seed)
    assert _sets(answer) == {frozenset({"moving_surface"})}
    found = answer["effects"][0]["parameters"]
    assert found["surface_velocity"]["value"] == pytest.approx(3e-4 / 2.5, rel=0.05)
    assert found["settling_time"]["value"] == pytest.approx(2.5, rel=0.05)


@pytest.mark.parametrize("seed", cases(1, 2))
def test_a_set_that_creeps_in_is_a_permanent_set(seed: int) -> None:
    x, v = _moved(seed)
    lowered = np.zeros_like(x)
    for i in range(1, x.size):
        rest = max(0.2 * x[i] - lowered[i - 1], 0.0)
        lowered[i] = lowered[i - 1] + rest * (1.0 - np.exp(-DT_S / 1.2))
    answer = _answer(x, _body(x - lowered, v - np.gradient(lowered, DT_S)), seed)
    assert _sets(answer) == {frozenset({"permanent_set"})}
    found = answer["effects"][0]["parameters"]
    assert found["share"]["value"] == pytest.approx(0.2, rel=0.1)
    assert found["creep_time"]["value"] == pytest.approx(1.2, rel=0.15)


@pytest.mark.parametrize("hardening", cases(3800.0, 0.0))
def test_a_body_that_flows_beyond_a_yield_force_keeps_a_permanent_set(hardening: float) -> None:
    """Bingham and Perzyna: viscosity * rate = k (x - s) - yield - hardening * s, never back."""
    stiffness, viscosity, yield_N = STIFFNESS, 1.1 * STIFFNESS, 0.5e-3 * STIFFNESS
    x, v = _moved(3)
    left = np.zeros_like(x)
    for i in range(1, x.size):
        over = stiffness * (x[i] - left[i - 1]) - yield_N - hardening * left[i - 1]
        left[i] = left[i - 1] + max(over, 0.0) / viscosity * DT_S
    answer = _answer(x, _body(x - left, v - np.gradient(left, DT_S)), 3)
    assert _sets(answer) == {frozenset({"permanent_set"})}
    found = {n: p["value"] for e in answer["effects"] for n, p in e["parameters"].items()}
    assert found["share"] == pytest.approx(stiffness / (stiffness + hardening), rel=0.1)
    assert found["creep_time"] == pytest.approx(viscosity / (stiffness + hardening), rel=0.15)
    assert found["yield_depth"] == pytest.approx(yield_N / stiffness, rel=0.15)


def test_structural_damping_is_hysteresis_or_the_friction_of_a_loaded_guide() -> None:
    """One force has two causes: a hysteresis by Reid, and friction that grows with the load."""
    x, v = _moved(3)
    answer = _answer(x, _body(x, v) + 400.0 * np.maximum(x, 0.0) * np.sign(v), 3)
    assert _sets(answer) == {frozenset({"hysteresis"}), frozenset({"coulomb_friction"})}
    beside = _answer(x, _body(x, v) + 400.0 * np.maximum(x, 0.0) * np.sign(v) + 0.02 * _T, 3)
    assert {frozenset(names) - {"force_drift"} for names in beside["class"]} == _sets(answer)


def _behind_a_nut(x: Row, size: float) -> Row:
    """Return the force of the spring and damper behind a joint that deflects as f to 2/3.

    Each sample is solved by bisection; the joint follows at once.
    """
    force, bent = np.zeros_like(x), np.zeros_like(x)

    def too_strong(f: float, i: int) -> float:
        now = size * f ** (2.0 / 3.0)
        p, rate = x[i] - now, (x[i] - now - x[i - 1] + bent[i - 1]) / DT_S
        return f - (STIFFNESS * p + DAMPING * rate)

    for i in range(1, x.size):
        if x[i] > 0.0 and too_strong(0.0, i) < 0.0:
            force[i] = brentq(too_strong, 0.0, 1e3, args=(i,))
            bent[i] = size * force[i] ** (2.0 / 3.0)
    return force


@pytest.mark.parametrize("seed", cases(1, 2))
def test_a_joint_that_seats_under_load_is_a_compliance_in_series(seed: int) -> None:
    x, _ = _moved(seed)
    answer = _answer(x, _behind_a_nut(x, 5e-5), seed)
    assert answer["class"][0] == ["series_compliance"]
    assert _sets(answer) <= {frozenset({n}) for n in ("series_compliance", "nonlinear_stiffening")}
    # The library's joint is linear at first and has another form.
    assert answer["error"]["after"] < 0.3 * answer["error"]["before"]


_MATERIALS = [SpringDamper(6e3, 1.0, 40.0, 0.0), SpringDamper(3e5, 1.5, 2e4, 1.5)]


@pytest.mark.parametrize("material", _MATERIALS, ids=["linear", "power"])
@pytest.mark.parametrize("joint", [Joint(2e-5, np.inf), Joint(4e-5, 3.0)], ids=["spring", "seats"])
def test_derivatives_behind_a_joint_are_those_of_its_force(
    material: SpringDamper, joint: Joint
) -> None:
    x, v = _moved(7)

    def force(k: float, b: float) -> Row:
        changed = material._replace(k=k, b=b)
        return np.asarray(press_in_series(x, v, changed, joint, DT_S, clamped=True)[0])

    k, b = material.k, material.b
    found, by_k, by_b = press_in_series(x, v, material, joint, DT_S, clamped=True, slopes=True)
    assert np.array_equal(found, force(k, b))
    for given, size, more in ((by_k, k, force(k * 1.00001, b)), (by_b, b, force(k, b * 1.00001))):
        expected = (more - found) / (1e-5 * size)
        assert np.max(np.abs(given - expected)) < 1e-3 * np.max(np.abs(expected))


@pytest.mark.parametrize("seats_at", [np.inf, 3.0])
def test_a_force_behind_a_joint_fulfils_the_law_of_both(seats_at: float) -> None:
    """Hertz's spring behind a joint, in rest: the force of the depth that the joint leaves."""
    x = np.linspace(1e-5, 2e-3, 50)
    spring, joint = SpringDamper(3e5, 1.5, 0.0, 1.5), Joint(5e-5, seats_at)
    force = press_in_series(x, np.zeros_like(x), spring, joint, DT_S, clamped=False)[0]
    left = x - 5e-5 * force / (1.0 + force / seats_at)
    assert np.allclose(force, 3e5 * left**1.5, rtol=1e-9)


@pytest.mark.parametrize(("side", "seed"), [(1.0, 1), (-1.0, 2)])
def test_a_cable_that_is_slack_on_one_side_is_a_return_spring(side: float, seed: int) -> None:
    x, v = _moved(seed)
    pulled = 600.0 * side * np.maximum(side * (x + 8e-4), 0.0)
    answer = _answer(x, _body(x, v) + pulled, seed)
    assert _sets(answer) == {frozenset({"return_spring"})}
    found = answer["effects"][0]["parameters"]
    assert found["spring_stiffness"]["value"] == pytest.approx(600.0, rel=0.03)
    assert found["rest"]["value"] == pytest.approx(-8e-4, abs=3e-5)


@pytest.mark.parametrize("damping", [0.0, 1e9])
def test_a_rigid_body_behind_a_joint_has_derivatives_of_zero(damping: float) -> None:
    """A fit may end there, where the joint alone gives way: they were not a number."""
    x, v = _moved(7)
    rigid = SpringDamper(1e25, 1.0, damping, 0.0)
    force, by_k, _ = press_in_series(
        x, v, rigid, Joint(4e-5, 3.0), DT_S, clamped=False, slopes=True
    )
    assert np.all(np.isfinite(by_k))
    assert np.all(1e-4 * rigid.k * by_k[x > 1e-5] < force[x > 1e-5])
