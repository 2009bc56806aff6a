"""The wall of a first touch, before any model."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.link.messages import StateMessage
from teleop_rt.master.provisional import NEWS, STATES_AT_REST, Provisional
from teleop_rt.master.walls import Wall
from teleop_rt_dev.campaign import touch

SOFT = 800.0
SURFACE, STIFFNESS, DAMPING, SPEED = 0.0137, 3600.0, 20.0, 0.04


def state(position: float, force: float, *, in_contact: bool = True) -> StateMessage:
    return StateMessage(
        position=position, force=force, contact_id=1, in_contact=in_contact, following=True,
        safety_state=0, fault=0, verified_free=0.0, velocity=0.0, energy_J=0.0,
        inadequate=False,
    )  # fmt: skip


def pressed(depth: float, speed: float = SPEED) -> StateMessage:
    return state(SURFACE + depth, STIFFNESS * depth + DAMPING * speed)


def begun() -> Provisional:
    first = Provisional(SOFT, 1.0)
    wall = first.begin(SURFACE, pressed(1e-4))
    assert (wall.surface, wall.k) == (SURFACE, SOFT)
    return first


def rests(first: Provisional, one: StateMessage) -> Wall | None:
    """Return the last wall that a tool shows, after as many states as that takes."""
    walls = [first.update(one) for _ in range(STATES_AT_REST)]
    return next((wall for wall in reversed(walls) if wall is not None), None)


def test_two_states_of_a_touch_are_the_walls_slope_and_place() -> None:
    first = begun()
    assert first.update(pressed(2e-4)) is None, "0.36 N is noise as well"
    wall = first.update(pressed(5e-4))
    assert wall is not None
    assert wall.k == pytest.approx(STIFFNESS)
    assert wall.surface == pytest.approx(SURFACE - DAMPING * SPEED / STIFFNESS)
    assert first.update(pressed(6e-4)) is None, "it is no news"


def test_a_softer_wall_than_the_first_is_news_too() -> None:
    first = begun()
    wall = first.update(state(SURFACE + 1e-2, 1e-4 * STIFFNESS + DAMPING * SPEED + 3.0))
    assert wall is not None
    assert wall.k < SOFT / NEWS


def test_on_the_way_out_and_in_the_air_nothing_is_learnt() -> None:
    first = begun()
    assert first.update(pressed(6e-4)) is not None
    assert first.update(pressed(5e-4, -20 * SPEED)) is None
    assert first.update(state(SURFACE + 0.01, 50.0, in_contact=False)) is None
    assert first.update(state(SURFACE - 0.001, 50.0)) is None


def test_a_jolt_of_the_touch_leaves_no_wall_stiffer_than_what_is_measured_at_rest() -> None:
    first = begun()
    jolt = first.update(state(SURFACE + 2e-4, 40.0))
    assert jolt is not None
    assert jolt.k > 10 * STIFFNESS
    deep = pressed(5e-3, 0.0)
    wall = rests(first, deep)
    assert wall is not None
    assert wall.elastic_force(deep.position) == pytest.approx(deep.force)
    assert wall.k < 1.1 * STIFFNESS
    assert first.update(pressed(5.1e-3, 0.0)) is None, "it is within the margin"


def test_the_damping_of_a_fast_approach_is_no_spring_for_the_hand_at_rest() -> None:
    fast = 10 * SPEED
    first = Provisional(SOFT, 1.0)
    first.begin(SURFACE, pressed(1e-4, fast))
    wall = first.update(pressed(5e-4, fast))
    assert wall is not None
    rest = pressed(6e-4, 0.0)
    assert wall.elastic_force(rest.position) > rest.force + 7.0
    wall = rests(first, rest)
    assert wall is not None
    assert wall.elastic_force(rest.position) == pytest.approx(rest.force, abs=1e-9)
    assert (wall.k, wall.surface <= SURFACE + 1e-4) == (pytest.approx(STIFFNESS), True)


def test_what_a_tool_feels_on_its_way_softens_no_wall() -> None:
    first = begun()
    assert first.update(pressed(5e-3)) is not None
    for step in range(40):
        depth = 5e-3 - 1e-4 * step
        assert first.update(state(SURFACE + depth, 0.5 * STIFFNESS * depth)) is None


def test_a_tool_that_feels_nothing_leaves_no_more_than_the_margin() -> None:
    first = begun()
    wall = first.update(pressed(5e-3))
    assert wall is not None
    for depth in (6e-3, 2e-4, 5e-3):
        wall = rests(first, state(SURFACE + depth, -0.1)) or wall
        assert wall.elastic_force(SURFACE + depth) <= 1.0 + 1e-9


def test_a_touch_that_was_over_when_its_news_came_is_measured_from_the_next_one() -> None:
    first = Provisional(SOFT, 1.0)
    first.begin(SURFACE, state(SURFACE - 0.01, 0.0, in_contact=False))
    assert first.update(pressed(1e-4)) is None
    wall = first.update(pressed(5e-4))
    assert wall is not None
    assert wall.k == pytest.approx(STIFFNESS)


def test_the_first_half_second_is_felt_before_an_estimator_has_converged() -> None:
    """With the soft wall alone, which the hand felt for 0.2 s, it was 0.30; with slopes, 0.05."""
    handle, tool_N = touch.run("model-mediated", 0.0, 1.2)
    nrmse, _, _, _ = touch.measures(handle, tool_N)
    assert nrmse < 0.025
    assert np.ptp(tool_N) > 10.0
