"""Stretched rubber: its force relaxes over decades of time, and its tangent falls with depth."""

from __future__ import annotations

import numpy as np
import pytest
from cases import cases

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.recordings.recording import from_arrays

_RATE_HZ = 50.0
_RELAXES = {"stress_relaxation", "fractional_relaxation"}


def _strip(t: Vector, x: Vector) -> Vector:
    """Return the force of a neo-Hookean strip by its convolution integral; it slackens, not pushes.

    It relaxes with the logarithm of time, as none of the declared laws does.
    """
    stretch = 1.0 + np.maximum(x, 0.0) / 0.04
    elastic = stretch - stretch**-2
    left = 1.0 / (1.0 + 0.35 * np.log1p(t / 0.05))
    force = np.convolve(np.diff(elastic, prepend=0.0), left)[: t.size]
    return np.maximum(force, 0.0)


def test_a_strip_that_slackens_is_relaxation_and_no_saturated_sensor() -> None:
    t = np.arange(800) / _RATE_HZ
    x = 0.08 * (1.0 - np.abs(2.0 * t / t[-1] - 1.0))
    rng = np.random.default_rng(3)
    force = _strip(t, x) + 2e-3 * rng.standard_normal(t.size)
    answer = diagnose(from_arrays("strip", t, x + 2e-7 * rng.standard_normal(t.size), force)).answer
    assert answer["class"]
    assert all(_RELAXES & set(names) for names in answer["class"])
    error = answer["error"]["std_normalised"]
    assert error["after"] < 0.2 * error["before"]


def _indented(power: float, left: Vector, dt: float) -> tuple[Vector, Vector]:
    """Return position and force of a tip in a gel whose elastic force relaxes (Lee, Radok 1960).

    By its convolution integral with `left`, the part of a unit step that is left as time passes.
    Each press ends where the force does.
    """
    t = dt * np.arange(left.size)
    x = 1.2e-3 * (0.6 * np.sin(2.0 * np.pi * 0.31 * t) + 0.4 * np.sin(2.0 * np.pi * 0.83 * t + 1.0))
    depth = np.maximum(x, 0.0)
    change = np.diff(depth**power, prepend=0.0)
    force = np.convolve(change, 0.5 + left)[: t.size] / 1e-3**power
    force += 0.02 * (depth / 1e-3) ** power * np.gradient(x, dt) / 1e-3
    return x, np.where(x > 0.0, np.maximum(force, 0.0), 0.0)


@pytest.mark.parametrize(("power", "law"), [(1.5, "arm"), *cases((2.0, "power"), (1.3, "arm"))])
def test_a_tip_in_a_gel_relaxes_and_rubs_at_nothing(power: float, law: str) -> None:
    """Its arms were those of a linear spring, and friction or a drift stood in for the rest."""
    dt, rng = 4e-3, np.random.default_rng(4)
    t = dt * np.arange(3000)
    left = 0.5 * np.exp(-t / 0.25) if law == "arm" else 0.2 * (t + dt) ** -0.3
    x, force = _indented(power, left, dt)
    force += 4e-3 * rng.standard_normal(t.size)
    recording = from_arrays("gel", t, x + 2e-8 * rng.standard_normal(t.size), force)
    answer = diagnose(recording, "hunt-crossley", surface=0.0).answer
    assert answer["class"]
    assert all(set(names) <= _RELAXES for names in answer["class"])
    assert answer["error"]["after_over_floor"] < 1.15


def _pulled(relaxing: float, slip_N: float = 0.0) -> tuple[Vector, Vector, Vector]:
    """Return time, position and force of a ring held on both sides, in cycles with rests.

    A spring of 2 N/mm with 1.8 N of pre-load; beside it an arm of `relaxing` [N/mm] that relaxes
    within 3 s, integrated in steps of a tenth of the sample, and a friction that turns over
    within 0.3 mm.
    """
    tops = np.repeat([4.0, 8.0, 12.0], 2)
    corners = [(0.0, 0.0)]
    for top in tops:
        for lasts, to in ((2.0, top), (5.0, top), (2.0, 1.0), (3.0, 1.0)):
            corners.append((corners[-1][0] + lasts, to))
    fine = np.arange(0.0, corners[-1][0], 0.005)
    x = np.interp(fine, *np.array(corners).T)
    arm, slip = np.zeros((2, fine.size))
    for i in range(1, fine.size):
        moved = x[i] - x[i - 1]
        arm[i] = arm[i - 1] + relaxing * moved - arm[i - 1] * 0.005 / 3.0
        slip[i] = slip[i - 1] + abs(moved) / 0.3 * (slip_N * np.sign(moved) - slip[i - 1])
    noise = 0.03 * np.random.default_rng(8).standard_normal(fine[::10].size)
    force = 1.8 + 2.0 * x[::10] + arm[::10] + slip[::10] + noise
    return fine[::10], 1e-3 * x[::10], force


@pytest.mark.parametrize(
    ("relaxing", "slip_N", "named"),
    [(1.4, 0.0, {"stress_relaxation"}), (0.0, 0.0, set()),
     (0.0, 1.5, {"coulomb_friction", "hysteresis", "stribeck_friction"})],
)  # fmt: skip
def test_a_body_that_is_held_all_along_relaxes_rubs_or_does_neither(
    relaxing: float, slip_N: float, named: set[str]
) -> None:
    recording = from_arrays("ring", *_pulled(relaxing, slip_N))
    answer = diagnose(recording, "spring,viscous,bias").answer
    assert answer["verdict"] in ({"named", "class"} if named else {"no_missing_effect"})
    assert {name for names in answer["class"] for name in names} <= named
    if relaxing:
        found = answer["effects"][0]["parameters"]
        assert found["time_constant"]["value"] == pytest.approx(3.0, rel=0.02)
        assert found["arm_stiffness"]["value"] == pytest.approx(1400.0, rel=0.02)


@pytest.mark.parametrize(("base", "relaxes"), [("spring,bias", True), ("mass-damper", False)])
def test_a_drive_without_a_spring_has_no_body_that_relaxes(base: str, relaxes: bool) -> None:
    recording = from_arrays("ring", *_pulled(0.0))
    possible = applicable(LIBRARY, recording, base_of(base))
    assert any(effect.name == "stress_relaxation" for effect in possible) is relaxes


def _smooth(seed: int) -> tuple[Vector, Vector]:
    """Return time [s] and position [m] of 10 s of a motion of six tones below 3 Hz."""
    rng, t = np.random.default_rng(seed), 1e-3 * np.arange(10_000)
    x = np.zeros(t.size)
    for _ in range(6):
        frequency_hz = 3.0 * (0.2 + 0.8 * rng.random())
        x += np.sin(2 * np.pi * frequency_hz * t + 6.28 * rng.random()) * (0.5 + rng.random())
    return t, 2e-3 + 8e-3 * x / np.max(np.abs(x))


def test_an_arm_is_found_where_the_surface_must_be_found_with_it() -> None:
    t, x = _smooth(41)
    depth, arm = np.maximum(x, 0.0), np.zeros(t.size)
    for i in range(1, t.size):
        arm[i] = arm[i - 1] * (1.0 - 1e-3 / 0.15) + depth[i] - depth[i - 1]
    force = 1200.0 * depth + 8.0 * np.gradient(x, t) + 800.0 * arm
    force = np.where(x > 0.0, np.maximum(force, 0.0), 0.0)
    # With this noise the descent beside the surface of three arms ended at their bounds.
    force += np.random.default_rng(11).normal(0.0, 0.03, 9 * t.size)[8 * t.size :]
    answer = diagnose(from_arrays("arm", t, x, force)).answer
    assert answer["class"] == [["stress_relaxation"]]
    found = answer["effects"][0]["parameters"]
    assert found["time_constant"]["value"] == pytest.approx(0.15, rel=0.02)
    assert answer["error"]["after_over_floor"] < 1.05
