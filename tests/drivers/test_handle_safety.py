"""The safety chain of the operator's device: each hazard takes the force away within 20 ms."""

from __future__ import annotations

import pytest
from test_operator_device import SERIAL, TRIAL, Handle

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config_rig import Limits
from teleop_rt.master import handle_faults as faults
from teleop_rt.master.handle_safety import HandleWatch

PUSH, WITHIN_TICKS = 10.0, 20
LIMITS = Limits(
    position_min=-0.2, position_max=0.2, velocity_max=1.5, acceleration_max=60, force_max=100
)


def pushing(trial, *changes):
    """A device whose motor pushes."""
    handle = Handle(trial, changes)
    handle.update(PUSH, 60)
    assert handle.plant.servo_force == pytest.approx(-PUSH, abs=0.3)
    return handle


def mute(device):
    return lambda handle: handle.network.inject("mute", device)


def reset_drive(handle):
    handle.network.inject("reset", "drive")


def weak_motor(handle):
    """The motor gives nothing of what is asked, and its drive says so."""
    handle.plant.push = lambda _: None
    handle.plant._pending.clear()
    handle.plant._command = 0.0


def fling(handle):
    """Nobody holds it any more, and it flies off."""
    handle.plant._let_go_s = 0.0
    handle.plant._handle[1] = 3.5


def carry_off(handle):
    handle.plant._handle[0] = handle.plant._handle[2] = 0.205


@pytest.mark.parametrize(
    ("trial", "hazard", "names"),
    [
        (TRIAL, mute("encoder"), {"handle_stale", "handle_device"}),
        (SERIAL, mute("encoder"), {"handle_stale", "handle_device"}),
        (TRIAL, mute("drive"), {"handle_not_enabled"}),
        (SERIAL, mute("drive"), {"handle_not_enabled", "handle_device"}),
        (TRIAL, reset_drive, {"handle_not_enabled", "handle_device"}),
        (TRIAL, fling, {"handle_overspeed", "handle_stale"}),
        (SERIAL, fling, {"handle_overspeed", "handle_stale"}),
        (TRIAL, carry_off, {"handle_end_of_travel", "handle_stale", "handle_overspeed"}),
    ],
)
def test_a_hazard_takes_the_force_to_zero_within_20_ms_and_is_named(trial, hazard, names):
    handle = pushing(trial)
    hazard(handle)
    handle.update(PUSH, WITHIN_TICKS)
    assert handle.watch.fault.name in names
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.05)
    handle.network.heal("drive" if "drive" in str(hazard) else "encoder")
    handle.update(PUSH, 50)
    assert handle.plant.servo_force == pytest.approx(0.0, abs=0.05), "it stays let go"


def test_a_motor_that_does_not_push_as_commanded_is_noticed():
    handle = Handle(TRIAL)
    handle.update(50.0, 60)
    weak_motor(handle)
    handle.update(50.0, WITHIN_TICKS)
    assert handle.watch.fault.name == "handle_force_off"


def judged(watch, ticks=30, asked=0.0, **sample):
    """The fault after some cycles of a sample."""
    for _ in range(ticks):
        whole = {"valid": True, "enabled": True, "drive_force": asked} | sample
        watch.update(Sample(**whole), 0.0)
        watch.commanded(asked)
    return watch.fault


def test_a_calm_device_in_a_persons_hand_is_left_alone():
    assert judged(HandleWatch(LIMITS, 1e-3), ticks=5000, asked=30.0) is faults.NO_FAULT


@pytest.mark.parametrize(("closed", "fault"), [(True, faults.NO_FAULT), (False, faults.RELEASED)])
def test_a_force_needs_the_enabling_switch_where_there_is_one(closed, fault):
    watch = HandleWatch(LIMITS, 1e-3, "switch")
    assert judged(watch, switch=True, asked=20.0) is faults.NO_FAULT
    assert judged(watch, switch=closed, asked=20.0) is fault


def test_a_free_device_may_be_without_its_switch():
    assert judged(HandleWatch(LIMITS, 1e-3, "switch"), switch=False) is faults.NO_FAULT


def test_a_few_missing_samples_are_bridged_and_ten_are_not():
    watch = HandleWatch(LIMITS, 1e-3)
    judged(watch, asked=20.0)
    assert judged(watch, ticks=8, asked=20.0, valid=False) is faults.NO_FAULT
    judged(watch, ticks=1, asked=20.0)
    assert judged(watch, ticks=10, asked=20.0, valid=False) is faults.STALE


def test_what_the_driver_reports_is_latched():
    watch = HandleWatch(LIMITS, 1e-3)
    judged(watch)
    assert judged(watch, ticks=1, fault=AxisFault.BUS_OFF) is faults.DEVICE
    assert judged(watch) is faults.DEVICE
