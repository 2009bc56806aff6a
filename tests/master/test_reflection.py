"""On a short link an unknown wall is felt by the slave's own force, until one can be rendered."""

from __future__ import annotations

import numpy as np
import pytest
from master_world import CONFIG, PERIOD_NS, World

from teleop_rt.link.impairment import Impairment
from teleop_rt.link.messages import StateMessage
from teleop_rt.master.wall_intake import REFLECTED_S, STILL_REFLECTED_S

SPEED, LATE_TICKS, LOSS = 0.04, 3, 0.3
NEVER = 10**6


class Approach:
    """A hand that goes in at a speed until a time, and out again as fast."""

    def __init__(self, back_s: float = 9.0) -> None:
        self._back_s = back_s

    def reset(self) -> None:
        pass

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        if t_s < self._back_s:
            return SPEED * t_s, SPEED
        return SPEED * (2 * self._back_s - t_s), -SPEED


def touched(world: World) -> World:
    """Return the world at the tick at which the master has heard of the touch."""
    for _ in range(2000):
        world.step()
        if world.master.intake.provisional:
            return world
    pytest.fail("the wall was not met")


def forces(world: World, ticks: int) -> np.ndarray:
    """Return the force on the hand and the slave's, of so many ticks."""
    rows = []
    for _ in range(ticks):
        world.step()
        rows.append((world.master.force, world.slave.force()))
    return np.array(rows)


@pytest.mark.parametrize("round_trip_ms", [0, 4])
def test_the_hand_feels_the_slaves_force_before_any_model(round_trip_ms: int) -> None:
    """With the wall of a touch it is up to 2 N off, and late by the slope's second state."""
    link = Impairment(delay_ns=round_trip_ms * PERIOD_NS // 2)
    world = touched(World(Approach(), there=link, model_after=NEVER, k=1200.0, b=0.0))
    felt, given = forces(world, 300).T
    assert world.master.intake.reflecting
    late = round_trip_ms // 2
    error = felt[10:] - given[10 - late : len(given) - late]
    assert np.abs(error).max() < 1200 * SPEED * PERIOD_NS * 1e-9 * LATE_TICKS
    assert given.max() > 10.0


def test_lost_states_are_bridged_by_a_spring() -> None:
    link = Impairment(loss=LOSS)
    world = touched(World(Approach(), there=link, model_after=NEVER, k=1200.0, b=0.0))
    felt, given = forces(world, 300).T
    assert world.master.intake.reflecting
    assert np.abs(felt[20:] - given[20:]).max() < 1.0
    assert np.abs(np.diff(felt)).max() <= CONFIG.force_step + 1e-9


def test_a_model_takes_over_without_a_step() -> None:
    world = touched(World(Approach(), model_after=150, k=3600.0))
    felt, _ = forces(world, 140).T
    assert world.master.intake.reflecting
    before = felt[-1]
    felt, _ = forces(world, 60).T
    assert not world.master.intake.reflecting
    assert not world.master.intake.provisional
    assert world.master.adoption.newest.k == pytest.approx(3600.0)
    by_motion = 3600.0 * SPEED * PERIOD_NS * 1e-9
    assert np.abs(np.diff(felt, prepend=before)).max() <= CONFIG.force_step + by_motion + 1e-9


def test_a_wall_too_stiff_to_be_reflected_is_rendered_once_it_has_a_slope() -> None:
    weak = CONFIG.model_copy(update={"device_damping": 8.0})
    world = touched(World(Approach(), config=weak, model_after=NEVER, k=3600.0))
    assert world.master.intake.reflecting
    most = world.master.limiter.stiffness_max_later(STILL_REFLECTED_S)
    assert most < 3600.0 < world.master.limiter.stiffness_max
    felt, _ = forces(world, 40).T
    assert not world.master.intake.reflecting
    assert world.master.intake.provisional
    assert world.master.adoption.newest.k == pytest.approx(3600.0, rel=0.5)
    assert np.abs(np.diff(felt)).max() <= CONFIG.force_step + 1e-9


def test_a_long_link_reflects_nothing() -> None:
    link = Impairment(delay_ns=round(0.6e9 * REFLECTED_S))
    world = touched(World(Approach(), there=link, model_after=NEVER))
    assert not world.master.intake.reflecting


@pytest.mark.parametrize(
    ("round_trip_s", "goes_on"),
    [(0.5 * (REFLECTED_S + STILL_REFLECTED_S), True), (1.1 * STILL_REFLECTED_S, False)],
)
def test_a_link_that_grows_longer_ends_it_later_than_it_begins(
    round_trip_s: float, *, goes_on: bool
) -> None:
    world = touched(World(Approach(), model_after=NEVER, k=1200.0))
    forces(world, 100)
    master, before = world.master, world.master.force
    assert master.slave is not None
    state = master.slave._replace(force=before)
    master.intake.take(None, state, master.hand, 0.5 * round_trip_s, 0.0)
    assert master.intake.reflecting == goes_on
    assert master.intake.provisional
    felt = master.adoption.elastic_force(master.x)
    assert felt == pytest.approx(before, abs=CONFIG.force_step)


def test_a_hand_that_leaves_is_not_followed_and_meets_the_wall_of_the_touch_again() -> None:
    world = touched(World(Approach(0.6), model_after=NEVER, k=1200.0))
    felt, _ = forces(world, 600).T
    master = world.master
    assert felt.max() > 5.0
    assert not world.slave.in_contact
    assert not master.intake.reflecting
    assert master.force == 0.0
    assert master.adoption.newest.surface == pytest.approx(world.slave.surface, abs=1e-3)


def test_a_device_that_cannot_render_the_soft_wall_reflects_nothing() -> None:
    without = CONFIG.model_copy(update={"device_damping": 0.0})
    world = World(Approach(), config=without, model_after=NEVER)
    for _ in range(600):
        world.step()
        assert not world.master.intake.reflecting
    assert isinstance(world.master.slave, StateMessage)
    assert world.master.slave.in_contact
    assert world.master.force == 0.0
