"""A surface that moves by itself, rendered moving: where it is now, and whose work it does."""

from __future__ import annotations

import pytest
from master_world import CONFIG, PERIOD_NS, World

from teleop_rt.link.impairment import Impairment
from teleop_rt.link.messages import ModelMessage
from teleop_rt.master.adoption import Adoption
from teleop_rt.master.energy import PassivityObserver
from teleop_rt.master.operators import Operator
from teleop_rt.master.tank import Tank
from teleop_rt.master.walls import MOTION_REMEMBERED_S, Wall

T = PERIOD_NS * 1e-9
COMING = Wall(0.0, 1000.0, surface_velocity=-0.005)
NO_CAP_W = 1e9


def adopted(wall: Wall) -> Adoption:
    adoption = Adoption(100.0, 0.5, Tank(0.05, 0.0))
    adoption.offer(wall)
    adoption.update(-1.0, 0.0, T)
    return adoption


def test_a_surface_goes_on_and_comes_to_rest_without_news() -> None:
    wall = COMING
    for _ in range(100):
        wall = wall.moved(T)
    assert wall.surface == pytest.approx(-0.5e-3, rel=0.1)
    for _ in range(10_000):
        wall = wall.moved(T)
    assert wall.surface == pytest.approx(-0.005 * MOTION_REMEMBERED_S, rel=0.01)
    assert abs(wall.surface_velocity) < 1e-6


def test_damping_resists_motion_against_the_surface() -> None:
    wall = Wall(0.0, 1000.0, 20.0, surface_velocity=0.01)
    assert wall.force(0.01, 0.01) == pytest.approx(10.0)
    assert wall.force(0.01, 0.0) == pytest.approx(10.0 - 0.2)


def test_what_a_surface_puts_into_the_spring_is_its_work() -> None:
    adoption = adopted(COMING)
    work_J = sum(adoption.move(0.01, T, NO_CAP_W) for _ in range(100))
    force = adoption.update(0.01, 0.0, T)
    assert force == pytest.approx(10.0 + 0.5, abs=0.05)
    assert work_J == pytest.approx((force**2 - 10.0**2) / 2000.0)


def test_a_surface_works_with_no_more_than_the_power_it_may() -> None:
    adoption, most_W = adopted(COMING), 0.01
    before = adoption.new.surface
    for _ in range(100):
        assert adoption.move(0.01, T, most_W) <= most_W * T * (1 + 1e-6)
    assert 0.0 < before - adoption.new.surface == pytest.approx(1e-4, rel=0.05)
    still = adopted(COMING)
    assert still.move(0.01, T, 0.0) == 0.0
    assert still.new.surface == pytest.approx(0.0, abs=1e-12)


def pushed_back(*, accounted: bool) -> tuple[PassivityObserver, float]:
    """A hand goes in by 10 mm, the surface comes by 4 mm, and the hand gives way to its force.

    Returns also the largest force [N] that was kept back.
    """
    adoption, observer = adopted(COMING), PassivityObserver(0.0, T, 1e-3, 0.0)
    kept = 0.0
    for tick in range(3000):
        x = min(0.01, 2e-5 * tick) - 15e-6 * max(0, tick - 1000)
        surface_J = adoption.move(x, T, NO_CAP_W)
        force = adoption.update(x, 0.0, T)
        stored_J = adoption.stored(x)
        work_J = surface_J if accounted else 0.0
        kept = max(kept, force - observer.update(x, 0.0, force, stored_J, 0.0, work_J))
        if accounted and tick > 10:
            assert abs(observer.made_J) < 2e-6
    return observer, kept


def test_the_work_of_a_surface_is_no_energy_that_the_rendering_makes() -> None:
    observer, kept = pushed_back(accounted=True)
    assert observer.missing_J < 1e-3
    assert observer.surface_J > 0.03
    assert kept == 0.0
    observer, kept = pushed_back(accounted=False)
    assert observer.missing_J < 1e-3, "the wall is cut off at the energy that the hand gave"
    assert kept > 1.0


class Resting(Operator):
    """A hand that goes to a place, and stays."""

    def reset(self) -> None:
        """Nothing is kept."""

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        return min(0.025, 0.05 * t_s), 0.05 if t_s < 0.5 else 0.0


@pytest.mark.parametrize("streamed", [True, False])
def test_a_surface_is_rendered_where_it_is_now_not_where_it_was(streamed: bool) -> None:
    velocity, one_way = 0.004, Impairment(delay_ns=200_000_000)
    world = World(Resting(), there=one_way, back=one_way)
    slave = world.slave
    for tick in range(4000):
        slave.surface = 0.0137 + (velocity * T * (tick - 1500) if tick > 1500 else 0.0)
        if slave.contact_id and tick > 1500:
            slave.model = ModelMessage(
                "kelvin-voigt", tick, slave.contact_id, slave.surface, k=3600.0, b=20.0,
                surface_velocity=velocity if streamed else 0.0, time_s=T * tick,
            )  # fmt: skip
        world.step()
    behind = slave.surface - world.master.adoption.newest.surface
    assert (abs(behind) < 0.1e-3) is streamed
    assert behind < 1.1e-3


def largest_power(most_mW: float) -> float:
    """Return the largest power [mW] of a surface that comes towards a hand in it at 20 mm/s."""
    world = World(Resting(), config=CONFIG.model_copy(update={"surface_power_mW": most_mW}))
    slave, work_J, largest_J = world.slave, 0.0, 0.0
    for tick in range(2000):
        came_m = 0.02 * T * max(0, tick - 1500)
        slave.surface = 0.0137 - came_m
        if slave.contact_id and tick > 1500:
            slave.model = ModelMessage(
                "kelvin-voigt", tick, slave.contact_id, slave.surface, k=3600.0, b=20.0,
                surface_velocity=-0.02, time_s=T * tick,
            )  # fmt: skip
        world.step()
        before_J, work_J = work_J, world.master.observer.surface_J
        largest_J = max(largest_J, work_J - before_J)
    return 1e3 * largest_J / T


def test_a_rendered_surface_has_no_more_power_on_the_hand_than_its_key_says() -> None:
    assert largest_power(1e6) > 500.0
    assert largest_power(100.0) == pytest.approx(100.0, rel=0.05)
    assert largest_power(0.0) == 0.0


def test_a_motion_is_not_continued_for_longer_than_it_was_seen() -> None:
    one_way, burst = Impairment(delay_ns=300_000_000), range(2590, 2690)
    world = World(Resting(), there=one_way, back=one_way)
    slave, nearest = world.slave, 0.0137
    for tick in range(3500):
        slave.surface = 0.0137
        if slave.contact_id and tick > 1500:
            slave.model = ModelMessage(
                "kelvin-voigt", tick, slave.contact_id, slave.surface, k=3600.0, b=20.0,
                surface_velocity=-0.02 if tick in burst else 0.0, time_s=T * tick,
            )  # fmt: skip
        world.step()
        if tick > 2500:
            nearest = min(nearest, world.master.adoption.newest.surface)
    assert 0.001 < 0.0137 - nearest < 1.1 * 0.02 * T * len(burst)
