"""The force itself, and columns made once, equal those of each row alone."""

from __future__ import annotations

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from teleop_rt.contact.effects import LIBRARY, find
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.least_squares import explained, least_squares
from teleop_rt.diagnosis.models.model import CandidateModel, Clamp, bounds
from teleop_rt.diagnosis.models.predict import columns, force_of, settled
from teleop_rt.diagnosis.models.simulate import late
from teleop_rt.diagnosis.samples.motion import RecordedMotion, differentiate

DT = 1e-3
T = DT * np.arange(2000)
X = 0.006 * np.sin(9.0 * T) + 0.001 * np.sin(33.0 * T) - 0.001
V = np.gradient(X, DT)
SCALES = {
    "": 1.0,
    "travel": 0.006,
    "place": 0.0,
    "middle": 0.0,
    "range": 20.0,
    "speed": 0.08,
    "duration": 2.0,
    "compliance": 5e-4,
    "force": 12.0,
}


@pytest.mark.parametrize("clamp", get_args(Clamp))
@pytest.mark.parametrize("base", ["kelvin-voigt", "hunt-crossley"])
def test_the_force_is_the_sum_of_the_columns_at_the_same_parameters(
    base: str, clamp: Clamp
) -> None:
    motion = RecordedMotion(T, X, V, np.gradient(V, DT), DT, SCALES)
    size = {"k": 2000.0, "b": 20.0}
    for first, second in zip(LIBRARY, LIBRARY[7:] + LIBRARY[:7], strict=True):
        model = CandidateModel(base_of(base), (first, second), clamp)
        edges = np.array([bounds(c.shape, motion.scales) for c in model.coordinates])
        zeta = edges.reshape(-1, 2) @ (0.6, 0.4)
        theta = np.array([size.get(linear.name, 0.7) for linear in model.linear])
        summed = columns(Course.of(model, motion, zeta), theta).sum(theta)
        # The memory of the motion holds this model's rows by now, that of another motion none.
        fresh = RecordedMotion(T, X, V, motion.a, DT, motion.scales)
        for place in (motion, fresh):
            found = force_of(model, place, zeta, theta)
            np.testing.assert_allclose(found, summed, atol=1e-9 * np.max(np.abs(summed)))


@pytest.mark.parametrize("steps", [0.0, 3.0, 7.3, -7.3, 3000.0])
def test_a_late_row_is_the_row_read_between_its_samples(steps: float) -> None:
    np.testing.assert_allclose(late(X, steps), np.interp(T - steps * DT, T, X), atol=1e-12)


def test_a_mass_is_accelerated_as_the_tip_moves() -> None:
    motion = RecordedMotion(T, X, V, np.gradient(V, DT), DT, SCALES)
    ripple = find("position_ripple", "of a screw's pitch")
    zeta = np.array([1e-4, 0.004, 0.3])
    moved = Course.of(CandidateModel(base_of("mass-spring-damper"), (ripple,)), motion, zeta).moved
    wanted = np.gradient(np.gradient(moved.x, DT), DT)[5:-5]
    np.testing.assert_allclose(moved.a[5:-5], wanted, atol=0.02 * np.max(np.abs(wanted)))


def test_a_clamp_has_settled_once_the_same_samples_pull() -> None:
    motion = RecordedMotion(T, X, V, np.gradient(V, DT), DT, SCALES)
    model = CandidateModel(base_of("kelvin-voigt"), clamp="base")
    course = Course.of(model, motion, np.zeros(0))
    assert settled(course, np.array([2000.0, 20.0]), np.array([1000.0, 10.0]))
    assert not settled(course, np.array([2000.0, 20.0]), np.array([2000.0, 40.0]))
    behind = replace(model, effects=(find("series_compliance"),))
    course = Course.of(behind, motion, np.array([1e-4]))
    assert not settled(course, np.array([2000.0, 20.0]), np.array([1000.0, 10.0]))


@pytest.mark.parametrize("damping", [1e18, 1e24])
def test_a_body_too_stiff_for_its_joint_gets_a_finite_force(damping: float) -> None:
    """Passes of depth and force diverge there: their numbers overflowed."""
    motion = RecordedMotion(T, X, V, np.gradient(V, DT), DT, SCALES)
    effects = (find("hunt_crossley"), find("series_compliance"))
    model = CandidateModel(base_of("hunt-crossley"), effects)
    zeta, theta = np.array([1.5, 1.83, 1e-4]), np.array([0.0, 5e4, damping])
    assert np.all(np.isfinite(force_of(model, motion, zeta, theta)))
    assert np.all(np.isfinite(columns(Course.of(model, motion, zeta), theta).offset))


def test_a_relaxed_body_releases_the_tool_before_its_spring_would() -> None:
    motion = RecordedMotion(T, X, V, np.gradient(V, DT), DT, SCALES)
    model = CandidateModel(
        base_of("kelvin-voigt"), (find("stress_relaxation", "one arm"),), clamp="base"
    )
    zeta, theta = np.array([0.1]), np.array([300.0, 0.0, 2000.0])
    free = force_of(replace(model, clamp="none"), motion, zeta, theta)
    assert np.min(free) < -1.0
    np.testing.assert_array_equal(force_of(model, motion, zeta, theta), free)
    whole = replace(model, clamp="body")
    np.testing.assert_allclose(force_of(whole, motion, zeta, theta), np.maximum(free, 0.0))
    damped, damping = theta + np.array([0.0, 40.0, 0.0]), np.where(X > 0.0, 40.0 * V, 0.0)
    np.testing.assert_allclose(
        force_of(replace(model, clamp="elastic"), motion, zeta, damped),
        np.maximum(free, 0.0) + damping,
        atol=1e-9,
    )


def test_rows_smoothed_together_are_smoothed_as_each_alone() -> None:
    rows = np.array([X, X**2, np.cos(5.0 * T)])
    together = differentiate(rows, DT, 20)
    for i, row in enumerate(rows):
        for found, alone in zip(together, differentiate(row, DT, 20), strict=True):
            np.testing.assert_allclose(found[i], alone, atol=1e-9 * np.max(np.abs(alone)))


@pytest.mark.parametrize("apart", [0.0, 1e-7, 1e-3])
def test_rows_that_are_nearly_alike_explain_what_one_does(apart: float) -> None:
    rng = np.random.default_rng(2)
    row, other, target = rng.standard_normal((3, 400))
    rows = np.array([row, row + apart * other])
    left = target - least_squares(rows, target) @ rows
    assert abs(row @ left) < 1e-6 * np.linalg.norm(row) * np.linalg.norm(target)
    alone = float(row @ target) ** 2 / float(row @ row)
    assert explained(rows, target) >= alone * (1.0 - 1e-6)
    assert explained(rows, target) <= float(target @ target)
