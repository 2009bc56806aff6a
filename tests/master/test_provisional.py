"""The wall of a first touch, before any model."""

from __future__ import annotations

import numpy as np
import pytest

from teleop_rt.link.messages import StateMessage
from teleop_rt.master.provisional import NEWS, Provisional
from teleop_rt_dev.campaign import touch

SOFT = 800.0
SURFACE, STIFFNESS, DAMPING, SPEED = 0.0137, 3600.0, 20.0, 0.04


def state(position: float, force: float, *, in_contact: bool = True) -> StateMessage:
    return StateMessage(
        position=position, force=force, contact_id=1, in_contact=in_contact, following=True,
        safety_state=0, fault=0, verified_free=0.0, velocity=0.0, energy_J=0.0, inadequate=False,
    )  # fmt: skip


def pressed(depth: float, speed: float = SPEED) -> StateMessage:
    return state(SURFACE + depth, STIFFNESS * depth + DAMPING * speed)


def begun() -> Provisional:
    first = Provisional(SOFT, 1.0)
    wall = first.begin(SURFACE, pressed(1e-4))
    assert (wall.surface, wall.k) == (SURFACE, SOFT)
    return first


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


def test_a_touch_that_was_over_when_its_news_came_is_measured_from_the_next_one() -> None:
    first = Provisional(SOFT, 1.0)
    first.begin(SURFACE, state(SURFACE - 0.01, 0.0, in_contact=False))
    assert first.update(pressed(1e-4)) is None
    wall = first.update(pressed(5e-4))
    assert wall is not None
    assert wall.k == pytest.approx(STIFFNESS)


def test_the_first_half_second_is_felt_before_an_estimator_has_converged() -> None:
    """With the soft wall alone, which the hand felt for 0.2 s, it was 0.30."""
    handle, tool_N = touch.run("model-mediated", 0.0, 1.2)
    nrmse, _, _, _ = touch.measures(handle, tool_N)
    assert nrmse < 0.1
    assert np.ptp(tool_N) > 10.0
