from __future__ import annotations

import math

import numpy as np
import pytest
from master_world import CONFIG, PERIOD_NS, World

from teleop_rt.link.impairment import Impairment
from teleop_rt.link.messages import ModelMessage, StateMessage
from teleop_rt.master.registration import PHANTOM_STATES, PhantomWatch, Registration
from teleop_rt.master.walls import NO_WALL, Wall
from teleop_rt.signals import MASTER, columns

COLUMN = columns(MASTER)
DT_S = PERIOD_NS * 1e-9


class Script:
    """A hand that moves along corner points (time [s], position) in straight lines."""

    def __init__(self, *corners: tuple[float, float]) -> None:
        self._times, self._places = zip(*corners, strict=True)

    def reset(self) -> None:
        pass

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        here, next_ = (float(np.interp(t, self._times, self._places)) for t in (t_s, t_s + DT_S))
        return here, (next_ - here) / DT_S


def delayed(round_trip_ms: int) -> Impairment:
    return Impairment(delay_ns=round_trip_ms * PERIOD_NS // 2)


def approach(speed: float) -> Script:
    return Script((0.0, 0.0), (100.0, 100.0 * speed))


@pytest.mark.parametrize(
    ("speed", "round_trip_ms"),
    [
        *((0.05, trip) for trip in (0, 30, 150, 1000, 4000)),
        *((speed, trip) for speed in (0.01, 0.1) for trip in (0, 1000)),
    ],
)
@pytest.mark.parametrize("model_after", [0, 10])
def test_the_wall_is_adopted_at_the_hand_without_force_or_energy(
    speed: float, round_trip_ms: int, model_after: int
) -> None:
    if round_trip_ms == 0 and model_after:
        pytest.skip("the slave's force is reflected until the model comes")
    world = World(approach(speed), there=delayed(round_trip_ms), model_after=model_after)
    for _ in range(30_000):
        before = world.master.adoption.newest
        world.step()
        if before is NO_WALL and world.master.adoption.newest is not NO_WALL:
            break
    else:
        pytest.fail("no wall was adopted")
    assert world.master.force == 0.0
    assert world.master.adoption.energy_J == 0.0
    assert world.master.adoption.new.energy(world.master.x) == 0.0
    assert world.master.x == pytest.approx(world.slave.surface, abs=speed * DT_S * 1.01)
    expected = speed * (round_trip_ms * 1e-3)
    assert world.master.registration.offset == pytest.approx(expected, abs=2.5 * speed * DT_S)
    assert max(world.slave.forces) <= (3600 * speed * DT_S + 20 * speed) * 1.01


def test_while_the_hand_keeps_still_after_contact_the_slave_rests_on_the_surface() -> None:
    world = World(Script((0, 0), (0.5, 0.025), (9, 0.025)), there=delayed(300))
    rows = world.run(3000)
    assert world.slave.position <= world.slave.surface + 0.05 * DT_S
    assert rows[-1, COLUMN["rendered_force"]] < 1.0
    assert rows[-1, COLUMN["offset"]] == pytest.approx(0.025 - 0.0137, abs=1e-4)


def test_on_a_later_contact_the_hand_meets_the_known_wall_first_and_no_offset_is_made() -> None:
    away = ((1.3, -0.03), (2.3, -0.05), (3.3, -0.03), (4.5, -0.03))
    script = Script((0, 0), (1, 0.03), *away, (5.5, 0.016), (9, 0.016))
    world = World(script, there=delayed(400))
    rows = world.run(8500)
    offset, force = rows[:, COLUMN["offset"]], rows[:, COLUMN["rendered_force"]]
    assert offset.max() > 0.005
    assert offset[4000] == 0.0
    assert not offset[4000:].any()
    felt = 4000 + np.argmax(force[4000:] > 0)
    acknowledged = np.argmax(rows[:, COLUMN["contact_id"]] == world.slave.contact_id)
    assert acknowledged - felt == pytest.approx(400, abs=5)
    assert force[-1] == pytest.approx(3600 * (0.016 - 0.0137), rel=1e-6)


def test_a_wall_that_has_come_nearer_is_again_adopted_at_the_hand() -> None:
    script = Script((0, 0), (1, 0.02), (1.5, -0.02), (4, -0.02), (6, 0.03))
    world = World(script, there=delayed(200))
    world.run(3500)
    world.slave.surface -= 0.008
    for _ in range(4000):
        world.step()
        if world.master.adoption.newest.surface == world.slave.surface:
            break
    else:
        pytest.fail("the new wall was not adopted")
    assert world.master.force == 0.0
    assert world.master.registration.offset > 0.003
    assert world.master.x == pytest.approx(world.slave.surface, abs=1e-4)


def test_a_refined_surface_never_moves_the_wall_under_the_hand() -> None:
    world = World(Script((0, 0), (1, 0.02), (9, 0.02)), there=delayed(100))
    world.run(1500)
    offset = world.master.registration.offset
    pressed = world.master.force
    assert pressed > 10
    for _ in range(20):
        world.slave.surface += 0.0001
        world.slave.model = ModelMessage(
            "kelvin-voigt", 9, 1, world.slave.surface, k=world.slave.k, b=world.slave.b
        )
        before = world.master.force
        for _ in range(60):
            world.step()
            assert abs(world.master.force - before) <= CONFIG.force_step + 1e-9
            before = world.master.force
    assert world.master.registration.offset == offset
    world.run(200)
    assert world.master.force == pytest.approx(pressed - 3600 * 0.002, rel=1e-3)


def offset_behind_a_wall() -> tuple[Registration, Wall]:
    """Return an offset of 5 mm, and the wall that made it, at 10 mm."""
    registration, wall = Registration(0.02, 0.0006), Wall(0.01, 1000.0)
    registration.adopt_at_hand(0.015, wall)
    assert registration.offset == pytest.approx(0.005)
    return registration, wall


def test_the_offset_vanishes_out_of_contact_at_its_speed_and_not_into_the_wall() -> None:
    registration, wall = offset_behind_a_wall()
    registration.relax(0.012, wall, DT_S)
    assert registration.offset == pytest.approx(0.005 - 0.02 * DT_S)
    for tick in range(2000):
        hand, before = 0.012 + 0.002 * math.sin(0.1 * tick), registration.offset
        registration.relax(hand, wall, DT_S)
        moved = registration.offset < before
        assert not moved or hand - registration.offset <= 0.01 - 0.0006 + 1e-12
    assert 0.010 - registration.offset == pytest.approx(0.01 - 0.0006, abs=1e-5)
    for tick in range(1000):
        registration.relax(-1e-4 * tick, wall, DT_S)
    assert registration.offset == 0.0


def test_a_handle_at_rest_keeps_its_offset() -> None:
    """The tool then came 16.4 mm nearer to the wall, with nobody at the handle."""
    registration, wall = offset_behind_a_wall()
    offsets = []
    for tick in range(3000):
        registration.relax(0.005 + 0.00005 * (-1) ** tick, wall, DT_S)
        offsets.append(registration.offset)
    assert offsets[2] == offsets[-1] > 0.0049, "nor does a trembling encoder move the tool"


@pytest.mark.parametrize("speed", [-0.1, -0.01, 0.01, 0.1])
def test_the_tool_goes_where_the_hand_goes_while_the_offset_vanishes(speed: float) -> None:
    registration, wall = offset_behind_a_wall()
    hand, own = -0.02, speed * DT_S
    registration.relax(hand, wall, DT_S)
    began = registration.offset
    for _ in range(200):
        before, x = registration.offset, hand - registration.offset
        hand += own
        registration.relax(hand, wall, DT_S)
        assert 0.5 - 1e-9 <= (hand - registration.offset - x) / own <= 1.5 + 1e-9
        assert before - registration.offset <= 0.02 * DT_S + 1e-12
    assert registration.offset < began


def test_a_phantom_wall_is_withdrawn_by_limited_steps_and_without_energy() -> None:
    world = World(Script((0, 0), (1, 0.02), (9, 0.02)), there=delayed(100), model_after=0)
    world.run(1500)
    assert world.master.force > 10
    world.slave.surface = 1.0
    spent = world.master.adoption.energy_J
    before, steps = world.master.force, []
    for _ in range(600):
        world.step()
        steps.append(abs(world.master.force - before))
        before = world.master.force
    assert world.master.intake.withdrawn >= 1
    assert max(steps) <= CONFIG.force_step + 1e-9
    assert world.master.force == pytest.approx(0.0, abs=1e-9)
    assert world.master.adoption.energy_J == pytest.approx(spent, abs=1e-3)
    world.slave.model = ModelMessage("kelvin-voigt", 99, 1, 0.0137, k=3600.0, b=20.0)
    world.run(200)
    assert world.master.force == pytest.approx(0.0, abs=1e-9), "kept withdrawn for this contact"


@pytest.mark.parametrize("surface", [0.0209, 0.0214, 0.0217, 0.0223])
def test_the_next_contact_of_a_body_that_went_away_is_not_felt_where_the_last_one_was(
    surface: float,
) -> None:
    """The slave's model still has the old place: its estimator finds the new one later."""
    go = Script((0, 0), (0.5, 0.02), (1, 0.02), (1.5, 0.024), (2, 0.024), (2.5, 0), (3.5, 0.018))
    world = World(go)
    world.run(900)
    assert world.master.force > 15.0
    slave, old = world.slave, world.slave.model
    assert old is not None
    slave.surface, slave.model_after, felt = surface, math.inf, []
    for _ in range(1080):
        slave.model = old._replace(contact_id=slave.contact_id, model_sequence=slave.contact_id)
        world.step()
        if slave.contact_id > 1 and slave.in_contact:
            felt.append(world.master.force - slave.force())
    assert world.master.intake.withdrawn >= 1
    assert len(felt) > 500
    assert max(felt) < 0.05 * CONFIG.force_max
    world.run(600)
    assert not slave.in_contact
    slave.surface = 0.0137
    world.run(1420)
    assert slave.in_contact
    assert world.master.force > 10.0
    assert world.master.force == pytest.approx(slave.force(), abs=0.5), "it came back"


def test_a_hand_that_presses_on_while_a_stiffer_wall_is_blended_in_gets_it() -> None:
    """The tank can pay for it where it is offered, and not 10 mm deeper: it stood at a fifth."""
    go = Script((0, 0), (1, 0.017), (1.56, 0.017), (1.66, 0.03), (9, 0.03))
    world = World(go, config=CONFIG.model_copy(update={"tank_power_mW": 0.0}))
    world.slave.k, world.slave.b = 600.0, 0.0
    world.run(1500)
    master = world.master
    world.slave.k = 3600.0
    world.slave.model = ModelMessage("kelvin-voigt", 99, 1, world.slave.surface, k=3600.0)
    world.run(700)
    assert master.adoption.newest.k == pytest.approx(3600.0)
    assert master.adoption.weight == 1.0
    assert master.force == pytest.approx(world.slave.force(), abs=0.5)


def free_at(position: float, *, in_contact: bool = False) -> StateMessage:
    return StateMessage(position, 0.0, 1, in_contact=in_contact, verified_free=position)


@pytest.mark.parametrize("velocity", [0.04, 0.0, -0.04])
def test_a_tool_that_is_pushed_as_by_the_wall_is_not_free(velocity: float) -> None:
    """Below the contact's onset force a slave that is inside the wall reports no contact."""
    watch, wall = PhantomWatch(2.0), Wall(0.0, 2500.0, 15.0)
    state = free_at(0.001)._replace(force=2.5 + 15.0 * velocity, velocity=velocity)
    assert all(watch.update(state, wall) is None for _ in range(100))
    lighter = state._replace(force=0.5)  # a phantom: less than the wall by more than its damping
    assert [watch.update(lighter, wall) for _ in range(PHANTOM_STATES)][-1] == 0.001


def test_only_lasting_and_noticeable_free_space_withdraws_a_wall() -> None:
    watch, wall = PhantomWatch(5.0), Wall(0.0, 3600.0)
    for state in (free_at(-0.01), free_at(0.001), free_at(0.01, in_contact=True)):
        assert all(watch.update(state, wall) is None for _ in range(100))
    found = [watch.update(free_at(0.01), wall) for _ in range(PHANTOM_STATES)]
    assert found[:-1] == [None] * (PHANTOM_STATES - 1)
    assert found[-1] == 0.01


def test_a_contact_without_a_model_is_met_with_a_soft_wall_and_then_with_what_states_show() -> None:
    world = World(approach(0.05), there=delayed(100), model_after=math.inf)
    while world.master.adoption.newest is NO_WALL:
        world.step()
    assert world.master.adoption.newest.k == pytest.approx(100.0 / 0.12)
    world.run(1000)
    assert world.slave.model is None
    assert world.master.adoption.new.k == pytest.approx(3600.0, rel=0.05)
    assert world.master.force > 0
    assert world.slave.position > world.slave.surface + 0.001


@pytest.mark.parametrize("withdraws_to", [0.0137, 0.004])
def test_a_touch_that_was_over_before_its_news_came_is_met_where_free_space_ends(
    withdraws_to: float,
) -> None:
    """The contact is acknowledged and the slave led on; it would wait for that wall for ever."""
    world = World(approach(0.05), there=delayed(100), model_after=math.inf)
    slave, surface = world.slave, world.slave.surface
    while not slave.in_contact:
        slave.muted = slave.position > surface - 0.001  # the states of the touch are lost
        world.step()
    world.run(5)
    slave.position, slave.surface = withdraws_to, 0.0138
    slave.in_contact, slave.muted = False, False
    slave.hold_at = withdraws_to
    for _ in range(200):
        world.step()
        if world.master.adoption.newest is not NO_WALL:
            break
    else:
        pytest.fail("no wall was adopted")
    slave.hold_at = math.inf
    assert world.master.adoption.newest.surface == pytest.approx(surface, abs=1e-4)
    assert world.master.force == 0.0
    world.run(500)
    assert world.master.row[COLUMN["contact_id"]] == slave.contact_id
    assert slave.position > slave.surface + 0.001


def test_what_states_or_a_model_show_takes_the_place_of_the_soft_wall_at_the_force_felt() -> None:
    """A stiff wall after a soft provisional one: neither a jump, nor energy, nor a push."""
    world = World(approach(0.05), there=delayed(100), model_after=200, k=20_000.0, b=0.0)
    for _ in range(2000):
        felt, provisional = world.master.force, world.master.adoption.new.k
        world.step()
        if world.master.adoption.newest.k == pytest.approx(20_000.0):
            break
    else:
        pytest.fail("the stiff wall was not adopted")
    assert provisional == pytest.approx(100.0 / 0.12)
    assert felt > 4.0
    assert world.master.force == pytest.approx(felt, abs=0.1)
    assert world.master.adoption.energy_J == 0.0
    assert world.master.x == pytest.approx(world.slave.surface + felt / 20_000.0, abs=1e-5)


def test_a_softer_first_model_leads_the_tool_deeper_at_the_pace_of_hand_and_offset() -> None:
    """As a step it drove the tool 5 mm deep at 0.5 m/s, into foam that locks there: 1.7 caps."""
    hand = Script((0, 0), (1, 0.016), (9, 0.016))
    world = World(hand, there=delayed(16), model_after=math.inf, k=3600.0, b=0.0)
    world.run(1100)
    master, slave = world.master, world.slave
    assert master.intake.provisional
    assert not master.intake.reflecting
    placed = master.registration.offset
    slave.k, slave.model_after = 600.0, slave.ticks_in_contact
    targets = [master.target]
    while master.registration.offset == placed:
        world.step()
        assert world.slave.tick < 3000, "the wall's place does not change"
    for _ in range(600):
        targets.append(master.target)
        world.step()
    assert placed - master.registration.offset > 0.003
    pace = (CONFIG.offset_speed + 0.016) * DT_S
    assert np.diff(targets).max() <= pace * (1 + 1e-9)
    assert master.target == pytest.approx(master.x), "it arrives"


def test_a_hand_that_withdraws_takes_the_tool_with_it_on_its_way_deeper() -> None:
    """Paced by the size of its speed, the tool went on deeper while the hand came back."""
    leaves_s = 1.2
    hand = Script((0, 0), (1, 0.016), (leaves_s, 0.016), (1.26, -0.01), (9, -0.01))
    world = World(hand, there=delayed(16), model_after=math.inf, k=3600.0, b=0.0)
    world.run(1100)
    master, slave = world.master, world.slave
    placed = master.registration.offset
    slave.k, slave.model_after = 600.0, slave.ticks_in_contact
    world.run(round(1000 * leaves_s) - 1100)
    assert placed - master.registration.offset > 0.003
    assert master.x - master.target > 0.003, "it is on its way"
    targets = []
    for _ in range(110):
        targets.append(master.target)
        world.step()
    # The hand is `placed` behind its script, which it follows at 0.016 m/s, and seen 8 ticks late.
    steps = np.diff(targets)[round(placed / 0.016 / DT_S) + 8 :]
    assert (steps < 0.0).all(), "never deeper while the hand comes back"
    assert master.target < master.x
    world.run(1000)
    assert master.target == master.x, "it is with the hand in free air"


def test_a_hand_that_is_put_less_deep_takes_the_tool_back_at_once() -> None:
    world = World(Script((0, 0), (1, 0.0257), (9, 0.0257)), k=400.0, b=3.0)
    world.run(2500)
    world.slave.k, world.slave.ticks_in_contact = 5000.0, 0
    offset = world.master.registration.offset
    while world.master.registration.offset == offset:
        world.step()
    assert world.master.registration.offset > offset
    assert world.master.target == world.master.x


def test_a_wall_that_turns_stiffer_than_the_tank_can_pay_is_taken_at_the_force_felt() -> None:
    world = World(Script((0, 0), (1, 0.0257), (9, 0.0257)), k=400.0, b=3.0)
    world.run(2500)
    felt = world.master.force
    assert felt == pytest.approx(400 * 0.012, rel=0.01)
    world.slave.k, world.slave.ticks_in_contact = 5000.0, 0
    forces = world.run(500)[:, COLUMN["rendered_force"]]
    assert np.abs(np.diff(np.concatenate(([felt], forces)))).max() <= CONFIG.force_step + 1e-9
    assert world.master.adoption.weight == 1.0
    assert forces[-1] == pytest.approx(felt, rel=0.01)
    assert world.slave.force() == pytest.approx(felt, rel=0.01), "the slave comes back"
    assert world.master.adoption.energy_J < CONFIG.tank_capacity_mJ * 1e-3


@pytest.mark.parametrize(("depth", "known"), [(-0.001, False), (0.001, True)])
def test_a_new_contact_with_a_known_wall_is_acknowledged_once_the_hand_is_in_it(
    depth: float, known: bool
) -> None:
    """Before that the wall may lie elsewhere for the slave, which waits for a model of it."""
    world = World(approach(0.05))
    world.run(2000)
    intake, master = world.master.intake, world.master
    before = intake.acknowledged
    assert before > 0
    hand = master.adoption.newest.surface + master.registration.offset + depth
    state = StateMessage(hand, 1.0, before + 1, in_contact=True, following=True)
    intake.take(None, state, hand, 0.0, 0.0)
    assert (intake.acknowledged == before + 1) is known
