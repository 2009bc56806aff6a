import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.config.rig import Limits
from teleop_rt.slave.limiter import Limiter

LIMITS = Limits(
    position_min=-0.05,
    position_max=0.05,
    velocity_max=0.5,
    acceleration_max=20.0,
    force_max=100.0,
)
DT = 1e-3
any_float = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=300, deadline=None)
@given(start=st.floats(-1, 1), targets=st.lists(any_float | st.floats(-0.1, 0.1), max_size=200))
def test_no_command_leaves_the_limits_whatever_is_asked(start, targets):
    limiter = Limiter(LIMITS, DT)
    limiter.reset(start)
    position, velocity = limiter.position, 0.0
    for target in targets:
        command = limiter.update(target)
        assert LIMITS.position_min <= command <= LIMITS.position_max
        new_velocity = (command - position) / DT
        assert abs(new_velocity) <= LIMITS.velocity_max * (1 + 1e-9)
        assert abs(new_velocity - velocity) <= LIMITS.acceleration_max * DT * (1 + 1e-6) + 1e-9
        position, velocity = command, new_velocity


def test_a_reachable_motion_is_followed_exactly():
    limiter = Limiter(LIMITS, DT)
    for tick in range(2000):
        target = 0.008 * (1 - math.cos(2 * math.pi * 3 * tick * DT)) / 2
        assert limiter.update(target) == pytest.approx(target, abs=1e-12)


def test_a_step_is_reached_with_no_more_overrun_than_three_changes_of_velocity():
    limiter = Limiter(LIMITS, DT)
    commands = [limiter.update(0.03) for _ in range(400)]
    assert commands[-1] == 0.03
    assert max(commands) <= 0.03 + 3 * LIMITS.acceleration_max * DT**2


def test_a_target_that_is_no_number_brakes_to_rest():
    limiter = Limiter(LIMITS, DT)
    for _ in range(50):
        limiter.update(0.04)
    moving = limiter.position
    stopped = [limiter.update(math.nan) for _ in range(100)]
    assert stopped[-1] == stopped[-2]
    assert stopped[-1] - moving < LIMITS.velocity_max**2 / LIMITS.acceleration_max


def test_a_motion_that_runs_at_the_end_of_the_range_is_braked_before_it():
    limiter = Limiter(LIMITS, DT)
    velocity = 0.0
    for tick in range(600):
        before = limiter.position
        target = min(LIMITS.position_max, 0.5 * LIMITS.acceleration_max * (tick * DT) ** 2)
        new_velocity = (limiter.update(target) - before) / DT
        assert abs(new_velocity - velocity) <= LIMITS.acceleration_max * DT * (1 + 1e-6) + 1e-9
        velocity = new_velocity
    assert limiter.position == pytest.approx(LIMITS.position_max, abs=1e-9)


@pytest.mark.parametrize("nowhere", [math.nan, math.inf, -math.inf])
def test_from_rest_a_target_that_is_no_place_moves_nothing(nowhere):
    limiter = Limiter(LIMITS, DT)
    limiter.reset(0.01)
    assert [limiter.update(nowhere) for _ in range(10)] == [0.01] * 10
