import math

import pytest

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config.realtime import LateConfig
from teleop_rt.config.rig import Limits
from teleop_rt.realtime.lateness import ON_HARDWARE
from teleop_rt.slave import faults
from teleop_rt.slave.faults import State
from teleop_rt.slave.safety import SafetyChain

LIMITS = Limits(
    position_min=-0.05, position_max=0.05, velocity_max=0.5, acceleration_max=20.0, force_max=100.0
)

MS = 1_000_000


def good() -> Sample:
    return Sample(valid=True, enabled=True)


def running_chain(late: LateConfig = ON_HARDWARE, rate_hz: int = 1000) -> SafetyChain:
    chain = SafetyChain(LIMITS, rate_hz, late)
    chain.configured()
    chain.check(good(), 0, motion=False)
    assert chain.arm()
    assert chain.start()
    chain.check(good(), 0, motion=True)
    assert chain.state == State.RUN
    return chain


def test_the_chain_leads_from_boot_to_run_only_through_arming():
    chain = SafetyChain(LIMITS, 1000)
    assert not chain.arm()
    chain.configured()
    assert chain.check(Sample(valid=False), 0, motion=True) == State.SELFTEST
    assert chain.check(good(), 0, motion=True) == State.DISARMED
    assert not chain.powered
    assert chain.arm()
    assert chain.check(Sample(valid=True, enabled=False), 0, motion=True) == State.ARMED
    assert chain.check(good(), 0, motion=True) == State.ARMED
    assert chain.start()
    assert chain.check(Sample(valid=True, enabled=False), 0, motion=True) == State.ARMED
    assert chain.check(good(), 0, motion=True) == State.RUN
    assert chain.check(good(), 0, motion=False) == State.HOLD
    assert chain.check(good(), 0, motion=True) == State.RUN


def test_three_missing_samples_hold_and_twenty_stop():
    chain = running_chain()
    for missing in range(1, 25):
        sample = good()
        sample.valid, sample.missing = False, missing
        state = chain.check(sample, 0, motion=True)
        if missing < 3:
            assert state == State.RUN
        elif missing < 20:
            assert state == State.HOLD
        else:
            assert state == State.SAFE_STOP
    assert chain.fault == faults.SAMPLES_LOST


@pytest.mark.parametrize("counted", [0, 5])
def test_cycles_without_a_valid_sample_stop_also_where_the_driver_does_not_count_them(counted):
    chain = running_chain()
    lost = good()
    lost.valid, lost.missing = False, counted
    states = [chain.check(lost, 0, motion=True) for _ in range(20)]
    assert states[2:] == [State.HOLD] * 17 + [State.SAFE_STOP]
    assert chain.fault == faults.SAMPLES_LOST


def test_a_valid_sample_ends_the_count_of_those_lost():
    chain = running_chain()
    lost = good()
    lost.valid = False
    for _ in range(3):
        assert [chain.check(lost, 0, motion=True) for _ in range(19)][-1] == State.HOLD
        assert chain.check(good(), 0, motion=True) == State.RUN


@pytest.mark.parametrize(
    ("rate_hz", "stop_ms", "last"),
    [(1000, 20, 19), (1000, 50, 49), (1000, 5, 19), (4000, 20, 79), (100, 20, 3), (300, 70, 21)],
)
def test_silent_sensors_stop_after_20_ms_and_as_long_a_time_as_a_stall_may_last(
    rate_hz, stop_ms, last
):
    chain = running_chain(LateConfig(hold_ms=5, stop_ms=stop_ms), rate_hz)
    sample = Sample(valid=False, enabled=True)
    for missing, then in ((last, State.HOLD), (last + 1, State.SAFE_STOP)):
        sample.missing = missing
        assert chain.check(sample, 0, motion=True) == then


@pytest.mark.parametrize("fault", [fault for fault in AxisFault if fault != AxisFault.NONE])
def test_every_fault_of_the_axis_stops_and_is_named(fault):
    chain = running_chain()
    sample = good()
    sample.fault = fault
    assert chain.check(sample, 0, motion=True) == State.SAFE_STOP
    assert not chain.powered
    assert chain.fault.name == fault.name.lower()
    assert chain.fault.cause
    assert chain.fault.next_step


@pytest.mark.parametrize(
    ("field", "value", "fault"),
    [
        ("force", 101.0, faults.FORCE_LIMIT),
        ("force", -101.0, faults.FORCE_LIMIT),
        ("position", 0.0551, faults.POSITION_LIMIT),
        ("position", -0.0551, faults.POSITION_LIMIT),
        ("position", math.nan, faults.POSITION_INVALID),
        ("position", math.inf, faults.POSITION_INVALID),
        ("force", math.nan, faults.FORCE_INVALID),
        ("force", -math.inf, faults.FORCE_INVALID),
    ],
)
def test_a_measured_limit_stops(field, value, fault):
    chain = running_chain()
    sample = good()
    setattr(sample, field, value)
    chain.check(sample, 0, motion=True)
    assert chain.fault == fault


@pytest.mark.parametrize(("position", "stops"), [(7.0, False), (math.nan, True), (math.inf, True)])
def test_an_axis_that_is_not_homed_may_be_anywhere_but_nowhere(position, stops):
    chain = SafetyChain(LIMITS, 1000)
    chain.configured()
    chain.check(good(), 0, motion=False)
    assert chain.arm()
    sample = good()
    sample.position = position
    chain.check(sample, 0, motion=False, homed=False)
    assert chain.powered != stops


@pytest.mark.parametrize(
    ("stall_ms", "then"),
    [(1, State.RUN), (4, State.RUN), (5, State.HOLD), (19, State.HOLD), (20, State.SAFE_STOP)],
)
def test_a_stall_holds_for_the_tick_after_it_from_5_ms_and_stops_from_20(stall_ms, then):
    chain = running_chain()
    assert chain.check(good(), stall_ms * MS, motion=True) == then
    after = State.SAFE_STOP if then == State.SAFE_STOP else State.RUN
    assert chain.check(good(), 0, motion=True) == after
    assert (chain.fault == faults.LATE_TICKS) == (then == State.SAFE_STOP)


def test_a_rig_with_bounds_of_its_own_is_judged_by_them_and_compared_with_hardware():
    wide = LateConfig(hold_ms=5, stop_ms=50, stop_share=1)
    chain = running_chain(wide)
    for stall_ms in (7, 0, 31, 0, 8):
        assert chain.check(good(), stall_ms * MS, motion=True) != State.SAFE_STOP
    assert (chain.late.holds, chain.late.stopped) == (3, False)
    assert (chain.on_hardware.holds, chain.on_hardware.stopped) == (2, True)


def test_a_fault_is_latched_and_a_reset_never_restarts_motion():
    chain = running_chain()
    chain.stop(faults.INTERNAL)
    chain.stop(faults.FORCE_LIMIT)
    assert chain.fault == faults.INTERNAL
    assert chain.check(good(), 0, motion=True) == State.SAFE_STOP
    stopped = Sample(valid=True, enabled=False)
    assert chain.check(stopped, 0, motion=True) == State.FAULT
    assert not chain.arm()
    assert chain.check(good(), 0, motion=True) == State.FAULT
    assert chain.reset()
    assert chain.check(good(), 0, motion=True) == State.DISARMED


def test_what_was_late_before_the_axis_was_armed_again_is_forgotten():
    chain = running_chain()
    for _ in range(50):
        assert chain.check(good(), 3 * MS, motion=True) == State.RUN
    chain.disarm()
    assert chain.arm()
    assert chain.start()
    for _ in range(50):
        assert chain.check(good(), 3 * MS, motion=True) == State.RUN
    assert chain.late.late_ticks == 300


def test_followings_and_holds_are_counted_once_each_as_they_begin():
    chain = SafetyChain(LIMITS, 1000)
    assert (chain.followings, chain.holds) == (0, 0)
    chain = running_chain()
    counted = []
    for motion in (True, True, False, False, True, True, False):
        chain.check(good(), 0, motion=motion)
        counted.append((chain.followings, chain.holds))
    assert counted == [(1, 0), (1, 0), (1, 1), (1, 1), (2, 1), (2, 1), (2, 2)]
