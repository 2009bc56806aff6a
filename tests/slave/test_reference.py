"""Tare and homing, cycle by cycle."""

from __future__ import annotations

import numpy as np
import pytest
from pydantic import ValidationError

from teleop_rt.axis import Sample
from teleop_rt.config.reference import HomingConfig, ReferenceConfig, TareConfig
from teleop_rt.config.rig import Limits
from teleop_rt.slave import faults
from teleop_rt.slave.faults import State
from teleop_rt.slave.homing import Homing, Phase
from teleop_rt.slave.reference import Reference
from teleop_rt.slave.tare import Tare

PERIOD_S = 1e-3
LIMITS = Limits(
    position_min=-0.05, position_max=0.05, velocity_max=0.5, acceleration_max=20.0, force_max=100.0
)
TARE = TareConfig(duration_ms=400, offset_max=5.0, noise_max=0.2, drift_max=0.5)
HOMING = HomingConfig(
    to="switch", position=-0.04, search=0.1, back_off=0.002, speed=0.05, slow_speed=0.005
)


def tared(offset=0.0, noise=0.05, drift=0.0):
    tare = Tare(TARE, PERIOD_S)
    rng = np.random.default_rng(3)
    forces = offset + drift * np.arange(400) * PERIOD_S + noise * rng.standard_normal(400)
    refused = [tare.update(force) for force in forces]
    assert refused[:-1] == [None] * 399
    return tare, refused[-1]


def test_tare_finds_offset_noise_and_drift_within_their_own_uncertainty():
    tare, refused = tared(offset=-3.0, drift=0.3)
    assert refused is None
    assert tare.done
    assert tare.offset == pytest.approx(-3.0 + 0.3 * 0.2, abs=4 * 0.05 / 20)
    assert tare.noise == pytest.approx(0.05, rel=0.15)
    assert tare.drift == pytest.approx(0.3, abs=4 * 0.05 * np.sqrt(12 / 400) / 0.4)


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ({"offset": 5.1}, faults.TARE_CONTACT),
        ({"offset": -5.1}, faults.TARE_CONTACT),
        ({"noise": 0.25}, faults.TARE_NOISE),
        ({"drift": 0.7}, faults.TARE_DRIFT),
        ({"offset": np.nan}, faults.TARE_CONTACT),
        ({"noise": np.nan}, faults.TARE_CONTACT),
    ],
)
def test_tare_refuses_contact_noise_and_drift(given, fault):
    tare, refused = tared(**given)
    assert refused == fault
    assert not tare.done


class Tool:
    """A tool that follows a cycle late, a switch below `switch`, and a wall above `wall`."""

    def __init__(self, config, start, switch=-np.inf, wall=np.inf, stopper=-np.inf):
        self.homing = Homing(config, LIMITS, PERIOD_S)
        self.switch, self.wall, self.stopper = switch, wall, stopper
        self.position, self.commands = start, []
        self.homing.start(self.sample())

    def sample(self):
        force = max(0.0, 1e5 * (self.position - self.wall))
        closed = bool(self.position <= self.switch)  # of a numpy number, where nothing is compiled
        return Sample(position=self.position, force=force, valid=True, enabled=True, switch=closed)

    def run(self):
        for _ in range(20_000):
            fault = self.homing.update(self.sample())
            self.commands.append(self.homing.command)
            self.position = max(self.homing.command, self.stopper)
            if fault is not None or self.homing.phase is Phase.DONE:
                return fault
        raise AssertionError("homing neither ends nor fails")


@pytest.mark.parametrize("start", [0.02, -0.0301], ids=["off the switch", "on the switch"])
def test_homing_finds_the_switch_from_either_side_without_a_jump(start):
    tool = Tool(HOMING, start, switch=-0.03)
    assert tool.run() is None
    assert tool.homing.shift == pytest.approx(-0.01, abs=6e-6)
    assert tool.homing.command == pytest.approx(-0.03 + 0.002, abs=6e-6)
    assert np.abs(np.diff([start, *tool.commands])).max() <= 0.05e-3 + 1e-12


@pytest.mark.parametrize("start", [0.2 + 3e-17, 2e3, -2e3])
def test_an_encoder_may_count_from_anywhere(start):
    config = HOMING.model_copy(update={"search": 0.098})  # its reach ends at 0 + 3e-17
    tool = Tool(config, start, switch=start - 0.05)
    assert tool.run() is None
    assert tool.homing.shift == pytest.approx(-0.04 - (start - 0.05), abs=6e-6)


def test_a_position_that_is_no_number_ends_homing():
    tool = Tool(HOMING, 0.02, switch=-0.03)
    sample = tool.sample()
    sample.position = np.nan
    assert tool.homing.update(sample) is faults.HOMING_STUCK


def test_homing_by_touch_finds_the_wall():
    touch = HOMING.model_copy(
        update={"to": "touch", "touch_force": 8.0, "direction": 1, "position": 0.0}
    )
    tool = Tool(touch, 0.0, wall=0.01)
    assert tool.run() is None
    assert tool.homing.shift == pytest.approx(-0.01 - 8.0 / 1e5, abs=6e-6)


def test_a_switch_that_is_never_found_ends_the_search_at_its_length():
    tool = Tool(HOMING, 0.02)
    assert tool.run() == faults.HOMING_NOT_FOUND
    assert min(tool.commands) == pytest.approx(0.02 - 0.1, abs=0.05e-3)


def test_a_tool_that_does_not_follow_is_stuck():
    tool = Tool(HOMING, 0.02, switch=-0.03, stopper=0.0)
    assert tool.run() == faults.HOMING_STUCK
    assert min(tool.commands) > -0.0021


def test_a_switch_that_stays_closed_is_stuck():
    tool = Tool(HOMING, 0.02, switch=-0.03)
    original = tool.sample
    stuck = []

    def sample():
        found = original()
        stuck.append(found.switch or any(stuck))
        found.switch = stuck[-1]
        return found

    tool.sample = sample
    assert tool.run() == faults.HOMING_STUCK


def test_zeros_are_lost_with_a_fault_and_found_again():
    reference = Reference(ReferenceConfig(tare=TARE), LIMITS, PERIOD_S)
    sample = Sample(force=2.0, valid=True)

    def wait():
        for _ in range(400):
            assert not reference.tared
            sample.force = 2.0
            reference.apply(sample)
            assert reference.update(State.DISARMED, sample) is None
        assert reference.ready

    wait()
    sample.force = 2.5
    reference.apply(sample)
    assert sample.force == pytest.approx(0.5)
    reference.update(State.FAULT, sample)
    assert not reference.tared
    wait()


def test_a_rig_without_references_is_ready_at_once_and_changes_nothing():
    reference = Reference(ReferenceConfig(), LIMITS, PERIOD_S)
    sample = Sample(position=0.01, force=3.0)
    reference.apply(sample)
    assert reference.ready
    assert (sample.position, sample.force, reference.raw(0.01)) == (0.01, 3.0, 0.01)


@pytest.mark.parametrize(
    "given",
    [
        {"homing": {**HOMING.model_dump(), "to": "touch", "touch_force": 5.0}},
        {"tare": TARE.model_dump(), "homing": {**HOMING.model_dump(), "touch_force": 8.0}},
        {"homing": {**HOMING.model_dump(), "slow_speed": 0.06}},
    ],
)
def test_a_homing_that_contradicts_itself_is_refused(given):
    with pytest.raises(ValidationError):
        ReferenceConfig.model_validate(given)
