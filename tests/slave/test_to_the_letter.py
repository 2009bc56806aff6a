"""Limits, counts and states at their very edge, which a mutation of the code would move.

`mutants.md` beside this lists the mutants that no test can distinguish from the code.
"""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.axis import Sample
from teleop_rt.config.rig import Limits
from teleop_rt.slave import faults
from teleop_rt.slave.faults import State
from teleop_rt.slave.hazards import Demand, force_exceeded, position_exceeded
from teleop_rt.slave.limiter import Limiter, brakeable
from teleop_rt.slave.record import TickRecord
from teleop_rt.slave.safety import SafetyChain

LIMITS = Limits(
    position_min=-0.25, position_max=0.75, velocity_max=0.5, acceleration_max=20.0, force_max=100.0
)
WIDE = Limits(
    position_min=-1000.0, position_max=1000.0, velocity_max=100.0, acceleration_max=1.0, force_max=1
)
RANGE = (LIMITS.position_min, LIMITS.position_max)
RATE_HZ = 1000


def good() -> Sample:
    return Sample(valid=True, enabled=True)


def disarmed() -> SafetyChain:
    chain = SafetyChain(LIMITS, RATE_HZ)
    chain.configured()
    chain.check(good(), 0, motion=False)
    assert chain.state is State.DISARMED
    return chain


def travelled_while_braking(velocity: float, step: float) -> float:
    """Sum of v, v - s, v - 2s ... while positive: an oracle that shares no formula."""
    total = 0.0
    while velocity > 0:
        total += velocity
        velocity -= step
    return total


@settings(deadline=None)  # the first example compiles the kernel
@given(st.floats(0, 50))
def test_the_fastest_velocity_that_can_still_brake_is_found_exactly(distance):
    record = TickRecord()
    Limiter(WIDE, 1.0, record)
    velocity = brakeable(record.tick, distance)
    assert travelled_while_braking(velocity * (1 - 1e-9), 1.0) <= distance + 1e-9
    assert travelled_while_braking(velocity + 1e-6, 1.0) > distance


def test_a_motion_at_the_very_limit_of_acceleration_is_followed_exactly():
    limiter = Limiter(WIDE, 1.0)
    assert [limiter.update(target) for target in (1.0, 3.0, 6.0)] == [1.0, 3.0, 6.0]
    assert limiter.limited == 0


def test_the_mirror_of_a_target_is_passed_without_a_jump():
    limiter = Limiter(LIMITS, 1e-3)
    limiter.reset(-0.1 - 20.0 * 1e-6)
    assert limiter.update(0.1) == pytest.approx(-0.1, abs=1e-12)


def test_each_command_that_was_changed_is_counted_once():
    limiter = Limiter(WIDE, 1.0)
    assert limiter.limited == 0
    for count in range(1, 4):
        limiter.update(500.0)
        assert limiter.limited == count
    limiter.reset(0.0)
    limiter.update(0.0)
    assert limiter.limited == 3


def test_a_chain_begins_without_fault_and_starts_nothing_that_is_not_armed():
    chain = SafetyChain(LIMITS, RATE_HZ)
    assert chain.fault is faults.NO_FAULT
    assert not chain.start()
    chain = disarmed()
    assert not chain.start()
    assert not chain.reset()
    chain.arm()
    assert not chain.reset()
    chain.disarm()
    assert chain.state is State.DISARMED


def test_arming_again_needs_starting_again():
    chain = disarmed()
    chain.arm()
    chain.start()
    assert chain.check(good(), 0, motion=True) is State.RUN
    chain.disarm()
    chain.arm()
    assert chain.check(good(), 0, motion=True) is State.ARMED


def test_a_drive_that_never_says_that_it_is_off_is_latched_after_exactly_a_second():
    for _ in range(2):
        chain = disarmed()
        chain.arm()
        chain.stop(faults.INTERNAL)
        states = [chain.check(good(), 0, motion=True) for _ in range(RATE_HZ)]
        assert states == [State.SAFE_STOP] * (RATE_HZ - 1) + [State.FAULT]
    assert chain.reset()
    assert chain.fault is faults.NO_FAULT


def test_a_force_at_its_limit_is_allowed_and_one_above_is_not():
    for sign in (1, -1):
        above = math.nextafter(100.0, 200.0)
        assert force_exceeded(sign * 100.0, LIMITS.force_max) == Demand.NONE
        assert force_exceeded(sign * above, LIMITS.force_max) == Demand.STOP
    assert force_exceeded(math.nan, LIMITS.force_max) == Demand.STOP


@pytest.mark.parametrize(("edge", "beyond"), [(-0.3, -1.0), (0.8, 1.0)])
def test_a_position_may_leave_the_range_by_five_percent_of_it_and_no_more(edge, beyond):
    assert LIMITS.position_min - 0.05 == pytest.approx(-0.3)
    inside = math.nextafter(edge, 0.25)
    outside = math.nextafter(math.nextafter(edge, beyond), beyond)
    for position in (edge, inside, edge * 0.99, 0.0):
        assert position_exceeded(position, *RANGE, homed=True) == Demand.NONE
    for position in (outside, math.nan):
        assert position_exceeded(position, *RANGE, homed=True) == Demand.STOP
    assert position_exceeded(math.nan, *RANGE, homed=False) == Demand.STOP


def test_a_position_says_nothing_of_the_limits_before_the_axis_is_homed():
    chain = disarmed()
    chain.arm()
    chain.start()
    far = good()
    far.position = 5.0
    assert chain.check(far, 0, motion=True, homed=False) is State.ARMED
    assert chain.check(far, 0, motion=True, homed=True) is State.SAFE_STOP
    assert chain.fault is faults.POSITION_LIMIT
