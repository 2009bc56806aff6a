"""The depth at which a model reaches a force, whatever the estimator made of it."""

import math

import pytest

from teleop_rt.slave.depth import HUNT_CROSSLEY, LINEAR, model_depth
from teleop_rt.slave.record import TickRecord


def depth(model, force=10.0, *, k=0.0, b=0.0, n=1.0, velocity=0.0):
    tick = TickRecord().tick
    tick.model, tick.model_k, tick.model_b, tick.model_n = model, k, b, n
    return model_depth(tick, force, velocity)


def test_a_spring_gives_force_over_stiffness_and_a_power_law_its_root():
    assert depth(LINEAR, k=1000.0) == pytest.approx(0.01)
    assert depth(HUNT_CROSSLEY, k=1000.0, n=2.0) == pytest.approx(0.1)


def test_what_the_damping_takes_on_the_way_in_is_not_left_for_the_spring():
    assert depth(LINEAR, k=1000.0, b=20.0, velocity=0.1) == pytest.approx(0.008)
    assert depth(LINEAR, k=1000.0, b=20.0, velocity=-0.1) == pytest.approx(0.01)
    assert depth(HUNT_CROSSLEY, k=1000.0, b=2000.0, velocity=0.5) == pytest.approx(0.005)


def test_without_a_model_no_depth_is_known():
    assert model_depth(TickRecord().tick, 10.0, 0.0) == math.inf


@pytest.mark.parametrize("n", [-2.0, 0.0, 0.05])
def test_an_exponent_that_no_contact_has_has_no_depth_and_stops_no_loop(n):
    assert depth(HUNT_CROSSLEY, force=0.0, k=1000.0, n=n) == math.inf
