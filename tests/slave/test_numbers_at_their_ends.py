"""A peer with the right key may still send any number: neither side's loop ends for it."""

from __future__ import annotations

import itertools
import sys

import pytest

from teleop_rt.cli.wiring import open_bench
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.slave.faults import State
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.trial.files import SILICONE, silicone

LARGE = (0.0, -0.0, 5e-324, 1e-300, 1e9, -1e9, 1e300, sys.float_info.max, -sys.float_info.max)
COUNTS = (0, 1, 2**31, 2**63 - 1, 2**63, 2**64 - 1)
CODES = (0, 1, 7, 8, 255)


@pytest.fixture
def trial(tmp_path):
    world = LockstepTrial(silicone(), SILICONE.parent, open_bench, tmp_path)
    world.slave.configure()
    while world.slave.safety.state is not State.RUN:
        world.step()
    return world


def test_a_motion_of_any_numbers_leaves_the_command_within_the_limits(trial):
    limits, slave = trial.trial.rig.limits, trial.slave
    received = trial.slave_endpoint.statistics.received
    sent = 0
    for target, velocity, surface in itertools.product(LARGE, LARGE, LARGE):
        for count in COUNTS:
            motion = MotionMessage(
                target,
                velocity,
                count,
                engaged=True,
                wall=True,
                surface=surface,
                force=target,
                energy_J=surface,
            )
            trial.master_endpoint.send(motion)
            trial.step()
            sent += 1
            assert limits.position_min <= slave.limiter.position <= limits.position_max
    assert trial.slave_endpoint.statistics.received - received >= sent


def test_a_state_of_any_numbers_leaves_the_masters_loop_alive(trial):
    received, sent = trial.master_endpoint.statistics.received, 0
    for position, force, count in itertools.product(LARGE, LARGE, COUNTS):
        for code in CODES:
            state = StateMessage(
                position,
                force,
                count,
                in_contact=True,
                following=True,
                safety_state=code,
                fault=code,
                verified_free=position,
                velocity=force,
            )
            trial.slave_endpoint.send(state)
            sent += 1
        trial.step()
    assert trial.master_endpoint.statistics.received - received >= sent
