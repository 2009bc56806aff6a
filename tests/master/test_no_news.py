"""Blackouts, in ticks of the stepped clock: keep rendering, freeze, declutch, fade, come back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from master_world import CONFIG, KEY, PERIOD_NS, World
from test_first_contact import Script

from teleop_rt.link.channel import Endpoint
from teleop_rt.link.impairment import Impairment
from teleop_rt.link.keys import shared_key
from teleop_rt.link.messages import StateMessage
from teleop_rt.link.troubles import TROUBLES
from teleop_rt.master.aim import Aim
from teleop_rt.master.engagement import LinkState
from teleop_rt.master.walls import Wall
from teleop_rt.signals import MASTER, columns

COLUMN = columns(MASTER)
PRESS = Script((0, 0), (1, 0.02), (30, 0.02))


def dark(start_ms: int, end_ms: int) -> Impairment:
    blackout = tuple(ms * PERIOD_NS for ms in (start_ms, end_ms))
    return Impairment(10 * PERIOD_NS, blackouts_ns=(blackout,))


def first(rows: np.ndarray, state: LinkState, after: int = 0) -> int:
    """Tick, from the start of the trial, at which the link state is first seen."""
    return after + int(np.argmax(rows[after:, COLUMN["state"]] == state)) + 1


def test_silence_freezes_then_declutches_then_fades_at_the_stated_ticks() -> None:
    world = World(PRESS, there=dark(2000, 9000), back=dark(2000, 9000))
    rows = world.run(5000)
    force = rows[:, COLUMN["rendered_force"]]
    last_news = 2000 - 1 + 10
    assert first(rows, LinkState.FROZEN) == last_news + 501
    assert first(rows, LinkState.DECLUTCHED) == last_news + 2001
    pressed = force[1990]
    assert pressed > 10
    np.testing.assert_allclose(force[2000 : last_news + 2000], pressed, rtol=1e-9)
    faded = force[last_news + 2000 : last_news + 2201]
    assert (np.diff(faded) <= 0).all()
    assert np.abs(np.diff(faded)).max() <= pressed / 200 * 1.01
    assert faded[100] == pytest.approx(pressed / 2, rel=0.02)
    assert not force[last_news + 2201 :].any()
    assert first(rows, LinkState.WAITING, 3000) == last_news + 2201


def test_a_frozen_master_asks_the_slave_to_stay_where_it_was() -> None:
    moving = Script((0, 0), (1, 0.02), (2.2, 0.02), (4.2, -0.02))
    world = World(moving, there=Impairment(), back=dark(2000, 9000))
    rows = world.run(4000)
    frozen = rows[:, COLUMN["state"]] == LinkState.FROZEN
    assert frozen.sum() > 1400
    assert len(np.unique(rows[frozen, COLUMN["target"]])) == 1
    assert len(np.unique(rows[frozen, COLUMN["position"]])) > 1000


def test_a_frozen_master_leads_no_more_so_that_the_slave_s_time_alone_counts_from_then() -> None:
    """It led until it declutched, 1.5 s later: for so long the tool pressed with nobody to see."""
    world = World(PRESS, there=Impairment(), back=dark(2000, 3000))
    asked, states = [], []
    for _ in range(4000):
        world.step()
        motion = world.slave.endpoint.motion
        asked.append(motion is not None and motion.engaged)
        states.append(world.master.engagement.state)
    frozen = states.index(LinkState.FROZEN)
    assert asked[frozen - 1]
    assert not any(asked[frozen + 1 : 2990])
    assert asked[3100], "and again with the first news"
    assert states[-1] == LinkState.ENGAGED


def test_news_after_a_freeze_bring_neither_a_step_of_force_nor_of_the_target() -> None:
    """A hand that moves takes the tool with it, at 0.5 to 1.5 times its pace."""
    moving = Script((0, 0), (1, 0.02), (2.2, 0.02), (4.2, 0.016), (6, 0.019), (9, 0.016))
    world = World(moving, there=dark(2000, 3500), back=dark(2000, 3500))
    rows = world.run(8500)
    force, target = rows[:, COLUMN["rendered_force"]], rows[:, COLUMN["target"]]
    assert first(rows, LinkState.ENGAGED, 3000) == pytest.approx(3511, abs=2)
    late = slice(1900, None)
    assert np.abs(np.diff(force[late])).max() < CONFIG.force_step
    speed = np.abs(np.diff(target[late])).max() / 1e-3
    assert speed <= CONFIG.offset_speed + 2 * 0.002 + 1e-9
    assert target[-1] == pytest.approx(rows[-1, COLUMN["position"]] - rows[-1, COLUMN["offset"]])


def at_rest_after_a_freeze(frozen_mm: float, hand_mm: float) -> tuple[Aim, list[float]]:
    """Return the aim, and the targets [mm] of 2 s of rest at `hand_mm`, frozen elsewhere before.

    There is a wall at 10 mm; the encoder trembles by 0.02 mm.
    """
    aim, wall = Aim(0.02, 0.0006, 1e-3), Wall(0.01, 1000.0)
    aim.update(1e-3 * frozen_mm, 0.0, 0.0, LinkState.ENGAGED, wall)
    aim.update(1e-3 * hand_mm, 0.0, 0.0, LinkState.FROZEN, wall)
    trembling = (1e-3 * (hand_mm + 0.02 * (-1) ** tick) for tick in range(2000))
    targets = [aim.update(hand, 0.0, 0.0, LinkState.ENGAGED, wall) for hand in trembling]
    return aim, [1e3 * target for target in targets]


@pytest.mark.parametrize(("frozen_mm", "hand_mm"), [(2.0, 8.0), (8.0, 2.0), (12.0, 20.0)])
def test_after_a_freeze_a_hand_at_rest_moves_no_tool(frozen_mm: float, hand_mm: float) -> None:
    aim, targets = at_rest_after_a_freeze(frozen_mm, hand_mm)
    np.testing.assert_allclose(targets, frozen_mm, atol=0.1)
    hand, before = 1e-3 * (hand_mm - 0.02), aim.target
    own = math.copysign(2e-5, frozen_mm - hand_mm)  # the hand comes to meet the tool
    for _ in range(2000):
        hand += own
        target = aim.update(hand, own, 0.0, LinkState.ENGAGED, Wall(0.03, 1000.0))
        if target == hand:
            break
        assert 0.49 < (target - before) / own < 1.51
        before = target
    assert target == hand


def test_after_a_freeze_a_tool_that_presses_deeper_than_the_hand_draws_back() -> None:
    """Nobody feels its contact: the hand has left the wall, and rests."""
    _, targets = at_rest_after_a_freeze(14.0, 8.0)
    assert targets[100] == pytest.approx(12.0, abs=0.1), "at the offset's speed"
    assert targets[-1] == pytest.approx(10.0, abs=0.1), "to the surface and no further"


def test_after_a_declutch_the_slave_is_asked_again_only_out_of_contact() -> None:
    world = World(PRESS, there=dark(2000, 5000), back=dark(2000, 5000))
    world.run(4900)
    assert world.slave.in_contact
    asked = []
    for tick in range(1500):
        if tick == 1000:
            world.slave.position = world.slave.surface - 0.005
        world.step()
        motion = world.slave.endpoint.motion
        asked.append(motion is not None and motion.engaged)
    assert not any(asked[200:1000])
    assert asked[-1]
    assert world.master.engagement.state == LinkState.ENGAGED
    assert world.slave.position == pytest.approx(world.slave.surface - 0.005, abs=0.005)


def test_coming_back_after_a_declutch_brings_no_step_of_force_or_position() -> None:
    world = World(PRESS, there=dark(2000, 5000), back=dark(2000, 5000))
    world.run(4900)
    world.slave.position = world.slave.surface - 0.01
    force, place = world.master.force, world.slave.position
    for _ in range(3000):
        world.step()
        assert abs(world.master.force - force) <= CONFIG.force_step + 1e-9
        assert abs(world.slave.position - place) <= CONFIG.offset_speed * 1e-3 + 1e-9
        force, place = world.master.force, world.slave.position
    assert world.master.engagement.state == LinkState.ENGAGED
    stood = world.slave.surface - 0.01
    assert world.slave.position == pytest.approx(stood, abs=0.001), "the hand rests: so does it"


def test_a_slave_that_does_not_follow_is_declutched_from() -> None:
    world = World(PRESS)
    world.run(1500)
    send = world.slave.endpoint.send
    world.slave.endpoint.send = lambda message: send(
        message._replace(following=False) if isinstance(message, StateMessage) else message
    )
    rows = world.run(3000)
    assert first(rows, LinkState.DECLUTCHED) == pytest.approx(2001, abs=3)
    assert rows[-1, COLUMN["rendered_force"]] == 0.0


def test_a_restarted_slave_is_not_taken_for_the_one_before() -> None:
    world = World(PRESS, there=Impairment(PERIOD_NS))
    world.run(2000)
    assert world.master.force > 10
    transport = world.slave.endpoint.transport
    world.slave.endpoint = Endpoint("slave", transport, shared_key(KEY), world.clock, rate_hz=1000)
    world.slave.contact_id, world.slave.in_contact, world.slave.model = 0, False, None
    world.slave.position = 0.0
    rows = world.run(6000)
    states = rows[:, COLUMN["state"]]
    assert LinkState.DECLUTCHED in states
    assert states[-1] == LinkState.ENGAGED
    assert world.slave.endpoint.connected
    force = rows[:, COLUMN["rendered_force"]]
    assert np.abs(np.diff(force)).max() <= CONFIG.force_step + 1e-9


def test_without_a_link_the_hand_feels_nothing_and_the_operator_does_not_start() -> None:
    world = World(PRESS, there=dark(0, 99_000), back=dark(0, 99_000))
    rows = world.run(1000)
    assert not rows[:, COLUMN["rendered_force"]].any()
    assert not rows[:, COLUMN["position"]].any()
    assert (rows[:, COLUMN["state"]] == LinkState.WAITING).all()


def test_with_another_key_the_operator_sees_the_cause_and_the_hand_feels_nothing() -> None:
    world = World(PRESS, slave_key=bytes(32))
    rows = world.run(3000)
    assert not rows[:, COLUMN["rendered_force"]].any()
    assert not world.slave.position
    assert (rows[:, COLUMN["state"]] == LinkState.WAITING).all()
    name, cause = TROUBLES[int(rows[-1, COLUMN["trouble"]])]
    assert name == "nothing"
    assert "same key and version" in cause
    assert "another key" in (world.slave.endpoint.trouble or "")
