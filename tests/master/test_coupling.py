"""Both ends of the modes without a model, without a link in between but a queue that delays."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import pytest

from teleop_rt.config.master import CouplingConfig, Mode
from teleop_rt.link.messages import MotionMessage, StateMessage
from teleop_rt.master import coupling as master
from teleop_rt.slave.coupling import couple, coupled, set_coupling
from teleop_rt.slave.record import TickRecord

DT_S = 1e-3
CONFIG = CouplingConfig()


class Following:
    """The slave's end of a mode, by the kernels of its tick."""

    def __init__(self, mode: Mode, config: CouplingConfig) -> None:
        self._tick = TickRecord().tick
        self._tick.period_s = DT_S
        set_coupling(self._tick, mode, config)
        self.energy_J = 0.0

    def start(self, position: float, motion: MotionMessage) -> None:
        self._hear(motion)
        self._tick.position = position
        couple(self._tick)

    def update(self, motion: MotionMessage, command: float, position: float, force: float) -> float:
        self._hear(motion)
        tick = self._tick
        tick.command, tick.position, tick.force = command, position, force
        target = float(coupled(tick))
        self.energy_J = float(tick.energy_J)
        return target

    def _hear(self, motion: MotionMessage) -> None:
        tick = self._tick
        tick.lead, tick.lead_force, tick.lead_energy_J = (
            motion.target, motion.force, motion.energy_J,
        )  # fmt: skip


def passive(config: CouplingConfig) -> Following:
    return Following("tdpa", config)


def tool(config: CouplingConfig) -> Following:
    return Following("four-channel", config)


def tdpa(delay: int, loss: float, seed: int) -> list[tuple[float, float, float, float]]:
    """Energy given by the hand, taken by it, given by the wall, taken by it; each tick's sums.

    The hand's motion is free and known one tick ahead; the wall is a spring that moves about.
    """
    rng = np.random.default_rng(seed)
    near, far = master.PassiveReflection(CONFIG), passive(CONFIG)
    there: deque[MotionMessage] = deque([MotionMessage(0.0, 0.0, 0, engaged=True)] * (delay + 1))
    back: deque[StateMessage] = deque([StateMessage(0.0, 0.0, 0, in_contact=False)] * (delay + 1))
    motion, news = there[0], back[0]
    far.start(0.0, motion)
    tones = rng.uniform(0.3, 6.0, 4)
    place = [0.004 * sum(math.sin(6.28 * hz * t * DT_S) for hz in tones) for t in range(6002)]
    command, sums = 0.0, np.zeros(4)
    result = []
    for tick in range(6000):
        x, ahead = place[tick], place[tick + 1]
        arrived = there.popleft()
        motion = motion if rng.random() < loss else arrived
        force = 4000.0 * max(0.0, command - 0.002 * math.sin(0.01 * tick)) + rng.normal(0, 0.05)
        target = far.update(motion, command, command, force)
        sums[2] += max(0.0, -force * (target - command))
        sums[3] += max(0.0, force * (target - command))
        command = target
        back.append(StateMessage(command, force, 1, in_contact=True, energy_J=far.energy_J))
        fresh = back.popleft()
        news = news if rng.random() < loss else fresh
        felt = near.update(x, (ahead - x) / DT_S, news, DT_S)
        sums[0] += max(0.0, felt * (ahead - x))
        sums[1] += max(0.0, -felt * (ahead - x))
        there.append(MotionMessage(ahead, 0.0, 0, engaged=True, energy_J=near.energy_J))
        result.append(tuple(sums))
    return result


@pytest.mark.parametrize("delay", [0, 40, 500])
@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_passive_channel_gives_no_more_than_it_was_given_and_its_reserve(
    delay: int, loss: float
) -> None:
    result = np.array(tdpa(delay, loss, seed=delay + 1))
    reserve_J = CONFIG.reserve_mJ * 1e-3 + CONFIG.reserve_mW * 1e-3 * DT_S * np.arange(1, 6001)
    hand_given, hand_taken, wall_given, wall_taken = result.T
    assert hand_given[-1] > 0.03
    assert np.all(hand_taken <= wall_given + reserve_J + 1e-9)
    assert np.all(wall_taken <= hand_given + reserve_J + 1e-9)


@pytest.mark.parametrize("mass", [0.2, 0.5])
def test_a_light_hand_that_is_thrown_back_takes_no_energy_that_is_not_there(mass: float) -> None:
    """Free to move, it turns round within a tick: an α v that is judged by its motion is late."""
    near = master.PassiveReflection(CouplingConfig(reserve_mJ=0.0, reserve_mW=0.0))
    slave_state = StateMessage(0.0, 30.0, 1, in_contact=True)
    x, velocity, taken_J, felt = 0.0, 0.0, 0.0, []
    for _ in range(3000):
        force = near.update(x, velocity, slave_state, DT_S)
        before = x
        velocity += (600.0 * (0.02 - x) - 5.0 * velocity - force) / mass * DT_S
        x += velocity * DT_S
        taken_J += max(0.0, -force * (x - before))
        felt.append(force)
    assert max(felt) > 5.0
    assert taken_J < 1e-4
    assert np.abs(np.diff(felt)).max() < 10.0  # no chatter between nothing and 30 N


def test_a_drive_that_lags_before_a_spring_is_credited_with_no_energy() -> None:
    """Its force lags behind the command: the product of both would gain with every cycle."""
    far, stiffness = passive(CONFIG), 3600.0
    far.start(0.01, MotionMessage(0.01, 0.0, 1, engaged=True))
    command = position = 0.01
    taken_J = 0.0
    for tick in range(3000):
        target = 0.01 + 0.004 * math.sin(2 * math.pi * 6.0 * tick * DT_S)
        motion = MotionMessage(target, 0.0, 1, engaged=True, energy_J=99.0)
        command = far.update(motion, command, position, stiffness * position)
        before, position = position, position + 0.2 * (command - position)
        taken_J += max(0.0, stiffness * position * (position - before))
    assert far.energy_J > 1.0
    assert far.energy_J <= taken_J + 0.5 * stiffness * 0.01**2


def test_a_loss_of_packets_loses_no_energy_of_the_account() -> None:
    far = passive(CONFIG)
    far.start(0.0, MotionMessage(0.0, 0.0, 0, engaged=True))
    late = MotionMessage(0.001, 0.0, 0, engaged=True, energy_J=0.5)
    assert far.update(late, 0.0, 0.0, 10.0) == pytest.approx(0.001)


def test_without_energy_the_wall_is_not_pressed_deeper_and_the_drift_is_taken_back_later() -> None:
    config = CouplingConfig(reserve_mJ=0.0, reserve_mW=0.0, drift_speed=0.05)
    far = passive(config)
    far.start(0.0, MotionMessage(0.0, 0.0, 0, engaged=True))
    blocked = MotionMessage(0.001, 0.0, 0, engaged=True)
    assert far.update(blocked, 0.0, 0.0, 10.0) == 0.0
    assert far.update(blocked, 0.0, 0.0, 0.0) == pytest.approx(0.05 * DT_S)
    command = 0.0
    for _ in range(30):
        command = far.update(blocked, command, command, 0.0)
    assert command == pytest.approx(0.001)


def test_direct_reflection_is_the_share_of_the_slaves_force() -> None:
    near = master.DirectReflection(CouplingConfig(force_gain=0.4))
    assert near.update(0.0, 0.0, StateMessage(0.0, 10.0, 0, in_contact=True), DT_S) == 4.0


@pytest.mark.parametrize("share", [1.0, 0.5])
def test_four_channels_in_balance_are_transparent(share: float) -> None:
    """Where both stand and the hand feels its share of the wall, the tool stays; so does it."""
    config = CouplingConfig(force_gain=share)
    near, far = master.TransparentReflection(config), tool(config)
    motion = MotionMessage(0.012, 0.0, 1, engaged=True, force=share * 7.0)
    far.start(0.012, motion)
    assert far.update(motion, 0.012, 0.012, 7.0) == pytest.approx(0.012)
    felt = near.update(0.012, 0.0, StateMessage(0.012, 7.0, 1, in_contact=True), DT_S)
    assert felt == pytest.approx(share * 7.0)


def test_four_channels_pull_both_sides_together() -> None:
    near, far = master.TransparentReflection(CONFIG), tool(CONFIG)
    pull = near.update(0.013, 0.0, StateMessage(0.012, 0.0, 0, in_contact=False), DT_S)
    assert pull == pytest.approx(CONFIG.stiffness * 0.001 / (1 + CONFIG.local_gain))
    motion, command = MotionMessage(0.013, 0.0, 0, engaged=True), 0.012
    far.start(command, motion)
    for _ in range(6000):
        command = far.update(motion, command, command, 0.0)
    assert command == pytest.approx(0.013, abs=1e-5)


def test_the_virtual_tool_yields_to_the_wall_by_its_mass() -> None:
    far = tool(CouplingConfig(stiffness=0.0, slave_damping=1e-9))
    motion = MotionMessage(0.0, 0.0, 0, engaged=True)
    far.start(0.0, motion)
    moved = far.update(motion, 0.0, 0.0, 3.0)
    config = CouplingConfig()
    assert moved == pytest.approx(-(1 + config.local_gain) * 3.0 / config.slave_mass * DT_S**2)
