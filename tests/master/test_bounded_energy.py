"""Walls that the master changes around a hand while its energy is bounded."""

from __future__ import annotations

import numpy as np
import pytest
from master_world import World
from test_first_contact import Script, delayed

from teleop_rt.link.messages import ModelMessage
from teleop_rt.master.energy import PassivityObserver
from teleop_rt.signals import MASTER, columns

FORCE = columns(MASTER)["rendered_force"]


def pressed(*then: tuple[float, float]) -> World:
    """A hand that presses 4.3 mm deep and rests, with its energy bounded from now on."""
    world = World(Script((0, 0), (1, 0.02), *then), there=delayed(100), b=0.0)
    world.run(1500)
    assert world.master.force > 15.0
    world.master.observer.bounded = True
    return world


def wall_moves(world: World, distance: float) -> None:
    world.slave.surface += distance
    world.slave.model = ModelMessage("kelvin-voigt", 9, 1, world.slave.surface, k=world.slave.k)


def test_a_wall_that_is_moved_away_from_a_resting_hand_only_falls() -> None:
    """Taken for a hand that leaves, the force fell below the new wall's and was back in 20 ms."""
    world = pressed((9, 0.02))
    before = world.master.force
    wall_moves(world, 0.002)
    forces = world.run(800)[:, FORCE]
    assert np.diff(forces).max() < 1e-6
    assert forces[-1] == pytest.approx(before - 3600 * 0.002, rel=1e-3)


@pytest.mark.parametrize("leaves_at", [0.0, 0.0004])
def test_a_stiffer_wall_of_the_felt_force_is_taken_over_without_a_step(leaves_at: float) -> None:
    """It holds less energy, as behind a hand that leaves: three quarters of the force went."""
    world = World(
        Script((0, 0), (1, 0.0257), (2.2, 0.0257), (12.2, 0.0257 - 10 * leaves_at)), k=400.0, b=3.0
    )
    world.run(2500)
    felt = world.master.force
    world.master.observer.bounded = True
    world.slave.k, world.slave.ticks_in_contact = 5000.0, 0
    forces = np.concatenate(([felt], world.run(500)[:, FORCE]))
    assert world.master.adoption.newest.k == pytest.approx(5000.0)
    assert np.abs(np.diff(forces)).max() < 0.1


def test_rounding_is_no_hand_that_leaves() -> None:
    """While the wall comes nearer in ticks to a hand whose force was late when it went in."""
    observer, stiffness = PassivityObserver(8e-3, 1e-3, 0.05, 0.005), 4000.0
    forces, depth = [], 0.0
    for tick in range(600):
        hand = 1e-5 * min(tick, 100)
        before, depth = depth, hand + 1e-6 * max(0, tick - 300)
        observer.bounded = tick >= 5
        stepped_J = 0.5 * stiffness * (depth - before) * (depth + before) if tick > 300 else 0.0
        stored_J = 0.5 * stiffness * depth**2
        forces.append(observer.update(hand, 0.0, stiffness * depth, stored_J, stepped_J=stepped_J))
    assert np.abs(np.diff(forces)).max() < 0.1


def test_a_wall_that_comes_nearer_is_not_felt_and_is_no_step_where_the_hand_turns() -> None:
    """The hand paid nothing for it: felt until the turn, it was taken away within a tick there."""
    world = pressed((2.5, 0.02), (4.5, 0.014))
    before = world.master.force
    wall_moves(world, -0.002)
    resting, leaving = world.run(900)[:, FORCE], world.run(500)[:, FORCE]
    assert resting.max() < before + 0.5
    assert np.abs(np.diff(np.concatenate((resting, leaving)))).max() < 0.2
