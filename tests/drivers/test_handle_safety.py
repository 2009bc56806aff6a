"""The safety chain of the operator's device: each hazard takes the force away within 20 ms."""

from __future__ import annotations

import math
import os
from pathlib import Path
from struct import Struct

import pytest

from teleop_rt.axis import AxisError, AxisFault, Sample
from teleop_rt.config.rig import Limits
from teleop_rt.master import handle_faults as faults
from teleop_rt.master.handle_safety import HandleWatch
from teleop_rt.master.held_key import HeldKey
from teleop_rt_dev.bench.lockstep import count
from teleop_rt_dev.faults.handle import CANOPEN, HandleBench
from teleop_rt_dev.faults.handle_rows import HANDLE_ROWS, PUSH_N, HandleRow, gone, play

LIMITS = Limits(
    position_min=-0.2, position_max=0.2, velocity_max=1.5, acceleration_max=60, force_max=100
)


@pytest.mark.parametrize("row", HANDLE_ROWS, ids=lambda row: row.name.replace(" ", "-"))
def test_a_hazard_takes_the_force_to_zero_within_20_ms_and_is_named(row):
    assert play(row).problem == ""


def test_without_a_hazard_nothing_is_taken_away():
    quiet = HandleRow("nothing", CANOPEN, lambda handle: None, frozenset({"handle_stale"}))
    assert "N after 20 ms" in play(quiet).problem


def judged(watch, ticks=30, asked=0.0, velocity=0.0, **sample):
    """The fault after some cycles of a sample."""
    for _ in range(ticks):
        whole = {"valid": True, "enabled": True, "drive_force": asked, "drive_position": 0.0}
        watch.update(Sample(**(whole | sample)), velocity)
        watch.commanded(asked)
    return watch.fault


def test_a_sample_is_judged_without_a_call_for_each_of_its_numbers(monkeypatch):
    watch, given = HandleWatch(LIMITS, 1e-3), []
    sample = Sample(valid=True, switch=True, position=0.1, drive_force=-2.0)
    monkeypatch.setattr(watch, "_judge", lambda *values: given.append(values))
    _, calls = count(lambda: watch.update(sample, 0.5))
    assert calls == 3  # with the functions above and before
    sample.fault, sample.drive_position, sample.drive_force = AxisFault.BUS_OFF, 0.2, None
    sample.enabled, sample.valid = True, False
    watch.update(sample, 0.5)
    plain, other = given
    assert plain[:6] == (True, False, True, False, 0.1, 0.5)
    assert math.isnan(plain[6])
    assert plain[7] == -2.0
    assert other[:7] == (False, True, True, True, 0.1, 0.5, 0.2)
    assert math.isnan(other[7])


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


@pytest.mark.parametrize(
    ("spoilt", "fault"),
    [
        ({"position": math.nan}, faults.END_OF_TRAVEL),
        ({"velocity": math.nan}, faults.OVERSPEED),
        ({"drive_force": math.nan}, faults.FORCE_OFF),
        ({"drive_force": None}, faults.FORCE_OFF),
        ({"drive_position": math.nan}, faults.POSITION_OFF),
        ({"drive_position": None}, faults.POSITION_OFF),
        ({"drive_position": 0.021}, faults.POSITION_OFF),
        ({"drive_position": 0.019}, faults.NO_FAULT),
        ({"position": 0.15, "drive_position": 0.15}, faults.NO_FAULT),
    ],
)
def test_what_is_measured_twice_must_agree_and_be_numbers(spoilt, fault):
    watch = HandleWatch(LIMITS, 1e-3)
    assert judged(watch, asked=20.0) is faults.NO_FAULT
    assert judged(watch, asked=20.0, **spoilt) is fault


@pytest.mark.parametrize("spoilt", [{"position": math.nan}, {"drive_force": math.nan}])
def test_a_device_that_begins_with_no_number_is_let_go(spoilt):
    assert judged(HandleWatch(LIMITS, 1e-3), asked=20.0, **spoilt) is not faults.NO_FAULT


def test_a_device_that_measures_once_is_not_compared_and_says_so():
    lacks = {"position_comparison": "one encoder", "force_comparison": "no torque"}
    watch = HandleWatch(LIMITS, 1e-3, lacks=lacks)
    assert judged(watch, drive_position=None, drive_force=None) is faults.NO_FAULT
    assert watch.unsafe[1:] == ["one encoder", "no torque"]


def test_an_encoder_that_sticks_takes_the_force_away():
    handle = HandleBench(CANOPEN)
    handle.update(PUSH_N, 60)
    handle.network.inject("freeze", "encoder")
    began = handle.plant.position
    while handle.watch.fault is faults.NO_FAULT:
        handle.update(PUSH_N)
        assert abs(handle.plant.position - began) < 0.025, "a twentieth of its travel is 0.02"
    assert handle.watch.fault is faults.POSITION_OFF
    handle.update(PUSH_N, 20)
    assert gone(handle)


EVENT = Struct("@llHHi")
SPACE, ENTER, KEY, RELATIVE = 57, 28, 1, 2


@pytest.fixture
def keyboard(tmp_path):
    """A pipe in the place of an input device: where to read, and how to press."""
    path = tmp_path / "event-kbd"
    os.mkfifo(path)
    key = HeldKey(str(path), SPACE)
    writer = os.open(path, os.O_WRONLY)

    def send(code: int, value: int, kind: int = KEY) -> None:
        os.write(writer, EVENT.pack(0, 0, kind, code, value))

    yield key, send, writer
    key.close()


def test_a_key_is_held_from_its_press_to_its_release(keyboard):
    key, send, _ = keyboard
    assert not key.update()
    send(ENTER, 1)
    send(SPACE, 1, RELATIVE)
    assert not key.update()
    send(SPACE, 1)
    send(SPACE, 2)  # it repeats
    assert key.update()
    assert key.update(), "no news"
    send(ENTER, 0)
    assert key.update()
    send(SPACE, 0)
    assert not key.update()


def test_a_keyboard_that_is_unplugged_holds_nothing(keyboard):
    key, send, writer = keyboard
    send(SPACE, 1)
    assert key.update()
    os.close(writer)
    assert not key.update()


def test_a_keyboard_that_cannot_be_read_is_said_with_the_next_step(tmp_path: Path):
    with pytest.raises(AxisError, match=r"cannot be read: No such file.*group input"):
        HeldKey(str(tmp_path / "none"), SPACE)


def test_a_device_without_a_switch_says_so_and_one_with_a_key_does_not():
    assert "no enabling switch" in HandleWatch(LIMITS, 1e-3, "none").unsafe[0]
    assert HandleWatch(LIMITS, 1e-3, "key").unsafe == []
    assert judged(HandleWatch(LIMITS, 1e-3, "key"), asked=20.0) is faults.RELEASED
