from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from teleop_rt.link.messages import ModelMessage
from teleop_rt.master.adoption import BLEND_S, Adoption
from teleop_rt.master.tank import Tank
from teleop_rt.master.walls import NO_WALL, Wall, wall_of

DT_S = 0.001
SOFT = Wall(surface=0.0, k=500.0, b=5.0)
STIFF = Wall(surface=0.0, k=5000.0, b=20.0)


def adopted(wall: Wall, *, force_step: float = 0.5, capacity_J: float = 1.0) -> Adoption:
    """An adoption that renders `wall` alone."""
    adoption = Adoption(100.0, force_step, Tank(capacity_J, 0.005))
    adoption.offer(wall)
    adoption.update(-0.01, 0.0, DT_S)
    assert adoption.weight == 1
    return adoption


def test_kelvin_voigt_force_is_2_1_and_never_pulls() -> None:
    assert SOFT.force(0.01, 0.1) == pytest.approx(500 * 0.01 + 5 * 0.1)
    assert SOFT.force(0.001, -1.0) == 0.0
    assert SOFT.force(-1e-9, 1.0) == 0.0


def test_unilateral_damping_acts_on_approach_alone_as_2_2() -> None:
    wall = wall_of(ModelMessage("kelvin-voigt-unilateral", 1, 1, 0.0, k=500.0, b=5.0))
    assert wall.force(0.01, 0.1) == pytest.approx(5.5)
    assert wall.force(0.01, -0.1) == pytest.approx(5.0)


def test_hunt_crossley_force_is_2_4() -> None:
    wall = wall_of(ModelMessage("hunt-crossley", 1, 1, 0.002, k=1500.0, b=50.0, n=1.5))
    assert wall.force(0.012, 0.2) == pytest.approx(0.01**1.5 * (1500 + 50 * 0.2))
    assert wall.force(0.012, -40.0) == 0.0


def test_mass_is_not_rendered() -> None:
    assert wall_of(ModelMessage("mass", 1, 1, 0.0, m=2.0)) is None
    wall = wall_of(ModelMessage("mass-spring-damper", 1, 1, 0.0, k=500.0, b=5.0, m=2.0))
    assert wall == SOFT


def test_a_model_without_surface_acts_on_both_sides() -> None:
    wall = wall_of(
        ModelMessage("kelvin-voigt", 1, 0, 0.1, surface_known=False, k=3.6, b=0.1, offset=-0.2)
    )
    assert wall.force(0.0, 0.5) == pytest.approx(-0.2 - 0.36 + 0.05)


@pytest.mark.parametrize("n", [1.0, 1.5, 2.2])
def test_stored_energy_is_the_work_of_the_spring(n: float) -> None:
    wall = Wall(surface=0.001, k=2000.0, n=n)
    steps = 20_000
    dx = 0.012 / steps
    work = sum(wall.elastic_force((i + 0.5) * dx) for i in range(steps)) * dx
    assert wall.energy(0.012) == pytest.approx(work, rel=1e-5)


@pytest.mark.parametrize("wall", [Wall(0.001, 2000.0, n=1.5), Wall(0.001, 900.0, bilateral=True)])
def test_a_spring_that_pushes_no_harder_stores_less(wall: Wall) -> None:
    limit, steps = 2.0, 20_000
    dx = 0.03 / steps
    forces = [wall.elastic_force(0.001 + (i + 0.5) * dx) for i in range(steps)]
    work = sum(min(limit, force) for force in forces) * dx
    assert max(forces) > 4 * limit
    assert wall.energy(0.031, limit) == pytest.approx(work, rel=1e-4)


def test_out_of_contact_a_wall_is_adopted_at_once() -> None:
    adoption = adopted(SOFT)
    adoption.offer(STIFF)
    assert adoption.update(-0.001, 0.0, DT_S) == 0.0
    assert adoption.weight == 1
    assert adoption.update(0.01, 0.0, DT_S) == pytest.approx(50.0)


@pytest.mark.parametrize(
    ("change_N", "lasts_s"),
    [(0.5, 0.2), (2.0, 0.2), (4.5, 0.3), (8.0, 0.4), (12.5, 0.5), (45, 0.5)],
)
def test_in_contact_the_force_moves_as_a_cosine_until_the_wall_is_adopted(
    change_N: float, lasts_s: float
) -> None:
    """A larger change takes longer, by its root: 24 N in 0.2 s made a hand ring by 1.4 mm."""
    adoption = adopted(SOFT)
    adoption.offer(Wall(surface=0.0, k=500.0 + 100.0 * change_N))
    forces = np.array([adoption.update(0.01, 0.0, DT_S) for _ in range(510)])
    shares = (forces - 5.0) / change_N
    expected = 0.5 * (1 - np.cos(np.pi * np.minimum(1.0, np.arange(1, 511) * DT_S / lasts_s)))
    assert shares == pytest.approx(expected, abs=1e-6)
    assert adoption.weight == 1
    assert adoption.energy_J == pytest.approx(100 * change_N * 0.01**2 / 2)


def test_the_force_moves_by_the_step_limit_at_most() -> None:
    adoption = adopted(Wall(surface=0.0, k=100.0))
    adoption.offer(Wall(surface=0.0, k=9000.0), 0.1)
    forces = [1.0, *(adoption.update(0.01, 0.0, DT_S) for _ in range(400))]
    assert np.diff(forces).max() == pytest.approx(0.5)
    assert forces[-1] == pytest.approx(90.0)


def test_a_little_other_wall_is_adopted_in_little_time() -> None:
    adoption = adopted(SOFT)
    adoption.offer(Wall(surface=0.0, k=505.0))  # 0.05 N more: a tenth of the step
    for _ in range(21):
        force = adoption.update(0.01, 0.0, DT_S)
    assert force == pytest.approx(5.05)


@pytest.mark.parametrize("mass", [0.6, 1.0, 1.5])
@pytest.mark.parametrize("way", [-0.002, 0.002])
def test_a_surface_that_falls_or_rises_does_not_set_off_a_hand(mass: float, way: float) -> None:
    """A hand with hardly any damping leans on 2 kN/m, and rings at 7 to 11 Hz once it is kicked."""
    adoption = adopted(Wall(surface=0.0, k=2000.0))
    hand_k, hand_b, goal, steps = 1000.0, 3.0, 0.018, 10
    x, v, places = goal * hand_k / (hand_k + 2000.0), 0.0, []
    for tick in range(1200):
        if tick == 100:
            adoption.offer(Wall(surface=-way, k=2000.0))
        force = adoption.update(x, v, DT_S)
        for _ in range(steps):
            v += (hand_k * (goal - x) - hand_b * v - force) / mass * DT_S / steps
            x += v * DT_S / steps
        places.append(x)
    rest = (goal * hand_k - 2000.0 * way) / (hand_k + 2000.0)
    after = np.array(places[100 + 200 :])
    assert np.ptp(after) < 0.2 * abs(way)  # 0.8 to 1.2 after a force that changes in 20 ms
    assert after[-1] == pytest.approx(rest, abs=0.1 * abs(way))


def test_an_empty_tank_stops_a_stiffer_wall_and_the_allowance_lets_it_on() -> None:
    adoption = adopted(SOFT, capacity_J=0.05)
    adoption.offer(STIFF)
    for _ in range(1000):
        adoption.update(0.01, 0.0, DT_S)
    assert adoption.energy_J == pytest.approx(0.05 + 0.005, rel=0.02)
    assert 0.2 < adoption.weight < 0.3
    for _ in range(35_000):
        adoption.update(0.01, 0.0, DT_S)
    assert adoption.weight == 1


def test_a_wall_of_the_same_force_and_more_energy_is_not_taken_on_without_payment() -> None:
    """Three walls push alike here; the softer and longer a spring, the more it holds."""
    longer, longest = (Wall(surface=0.01 - 50.0 / k, k=k, b=0.0) for k in (2500.0, 1000.0))
    adoption = adopted(STIFF, capacity_J=0.05)
    adoption.offer(longer)
    for _ in range(100):
        adoption.update(0.01, 0.0, DT_S)
    assert 0.1 < adoption.weight < 0.3
    adoption.offer(longest)
    for _ in range(100):
        assert adoption.update(0.01, 0.0, DT_S) == pytest.approx(50.0)
        assert adoption.tank.level_J >= 0.0


def test_a_wall_of_the_felt_force_is_taken_over_while_the_hand_goes_deeper() -> None:
    """At 0.1 m/s into it, its damping alone is a step; blended in 0.2 s it meets 20 mm more."""
    adoption, x = adopted(SOFT), 0.01
    felt = adoption.update(x, 0.1, DT_S)
    stiff = Wall(surface=x - SOFT.elastic_force(x) / STIFF.k, k=STIFF.k, b=STIFF.b)
    adoption.offer(stiff, 0.0)
    forces = [felt]
    for _ in range(10):
        x += 0.1 * DT_S
        forces.append(adoption.update(x, 0.1, DT_S))
    assert adoption.weight == 1
    assert forces[-1] == pytest.approx(stiff.force(x, 0.1))
    steps = np.diff(forces) - STIFF.k * 0.1 * DT_S
    assert steps.max() <= 0.5 + 1e-9


def test_in_the_middle_of_a_blend_a_wall_of_the_felt_force_takes_its_place() -> None:
    adoption, x = adopted(SOFT), 0.01
    adoption.offer(STIFF)
    for _ in range(250):
        felt = adoption.update(x, 0.0, DT_S)
    assert 0.4 < adoption.weight < 0.6
    right = Wall(surface=x - felt / 3000.0, k=3000.0)
    adoption.offer(right, 0.0)
    assert adoption.update(x, 0.0, DT_S) == pytest.approx(felt)
    assert (adoption.new, adoption.weight) == (right, 1.0)


def test_a_blend_that_the_tank_has_not_paid_for_a_while_is_starved() -> None:
    adoption = adopted(SOFT, capacity_J=0.01)
    adoption.offer(STIFF)
    starved = [adoption.update(0.01, 0.0, DT_S) > 0 and adoption.starved for _ in range(300)]
    assert not any(starved[:100])
    assert starved[-1]
    adoption.offer(Wall(surface=0.01 - 10.0 / 6000.0, k=6000.0))
    assert not adoption.starved, "a new wall, a new chance"


@pytest.mark.parametrize("k", [400.0, 3000.0, 9000.0])
@pytest.mark.parametrize("level_J", [0.0, 0.02, 1.0])
def test_a_wall_is_placed_at_the_felt_force_or_at_the_energy_there_is(
    k: float, level_J: float
) -> None:
    """10 mm deep in a wall of 5000 N/m 50 N are felt, and 0.25 J stored."""
    adoption, wall = adopted(STIFF), Wall(surface=0.05, k=k)
    adoption.tank.level_J = level_J
    place = adoption.place_of(wall, 0.01)
    force, stored_J = wall.elastic_force(place), wall.energy(place)
    if 50.0**2 / (2 * k) <= 0.25 + level_J:
        assert force == pytest.approx(50.0)
    else:
        assert force < 50.0
        assert stored_J == pytest.approx(0.25 + level_J, rel=1e-3)
    assert stored_J <= 0.25 + level_J + 1e-12


def test_walls_that_come_faster_than_a_blend_takes_move_the_force_one_way() -> None:
    """A surface that rises by 0.6 mm each 40 ms; each news sent the blend back, and 2 N with it."""
    adoption = adopted(Wall(surface=0.0, k=3000.0))
    forces = []
    for tick in range(600):
        if tick % 40 == 0:
            adoption.offer(Wall(surface=-0.0006 * (tick // 40), k=3000.0))
        forces.append(adoption.update(0.003, 0.0, DT_S))
    assert np.diff(forces).min() >= 0.0
    assert forces[-1] > 20.0


def test_a_softer_wall_needs_no_energy() -> None:
    adoption = adopted(STIFF, capacity_J=0.0)
    adoption.offer(SOFT)
    for _ in range(501):
        force = adoption.update(0.01, 0.0, DT_S)
    assert force == pytest.approx(5.0)
    assert adoption.energy_J == 0.0


def test_a_blend_that_cannot_be_paid_does_not_block_a_later_wall() -> None:
    adoption = adopted(SOFT, capacity_J=0.01)
    adoption.offer(STIFF)
    for _ in range(500):
        adoption.update(0.01, 0.0, DT_S)
    assert adoption.weight < 0.2
    right = Wall(surface=0.0, k=550.0, b=5.0)
    adoption.offer(right)
    for _ in range(510):
        force = adoption.update(0.01, 0.0, DT_S)
    assert adoption.new is right
    assert force == pytest.approx(5.5)


@settings(max_examples=150, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.integers(1, 40),
            st.floats(-0.003, 0.004),
            st.floats(0, 20_000),
            st.floats(0, 100),
            st.floats(1, 2.5),
            st.sampled_from([BLEND_S, 0.1, 0.0]),
        ),
        min_size=1,
        max_size=12,
    ),
    st.floats(0.01, 5.0),
)
def test_adoption_never_steps_the_force_nor_overdraws_the_tank(
    walls: list[tuple[int, float, float, float, float, float]], force_step: float
) -> None:
    capacity_J = 0.05
    adoption = Adoption(100.0, force_step, Tank(capacity_J, 0.005))
    tick = 0
    for ticks, surface, k, b, n, lasts_s in walls:
        adoption.offer(Wall(surface, k, b, n), lasts_s)
        for _ in range(ticks):
            tick += 1
            x = 0.004 + 0.006 * math.sin(0.02 * tick)
            v = 0.12 * math.cos(0.02 * tick)
            laws = (adoption.old, adoption.new, adoption.weight)
            unblended = blend(laws, x, v)
            inside = adoption.holds(x) or adoption.newest.holds(x)
            force = adoption.update(x, v, DT_S)
            if inside:
                assert abs(force - unblended) <= force_step + 1e-9
            assert -1e-12 <= adoption.tank.level_J <= capacity_J
            assert 0 <= adoption.weight <= 1
            assert 0 <= force <= 100.0


def blend(laws: tuple[Wall, Wall, float], x: float, v: float) -> float:
    """The force of the blend as it stands, before it moves."""
    old, new, weight = laws
    old_force, new_force = (min(100.0, wall.force(x, v)) for wall in (old, new))
    return old_force + weight * (new_force - old_force)


def test_no_wall_gives_no_force() -> None:
    adoption = Adoption(100.0, 0.5, Tank(0.05, 0.005))
    assert adoption.new is NO_WALL
    assert adoption.update(1.0, 1.0, DT_S) == 0.0
