"""First contact under delay with the real slave, estimators and link, on an ideal axis."""

from __future__ import annotations

import math

import pytest

from teleop_rt.slave.pace import DEPTH_SHARE
from teleop_rt.study.delay_plant import DRIVE_HZ, MATERIALS, PERIOD_S, SURFACE_M
from teleop_rt.study.delay_world import FORCE_CAP_N, Cell, World

ROUND_TRIPS_MS = (0.0, 30.0, 150.0, 270.0, 700.0, 1000.0, 2000.0, 4000.0)


class Relentless:
    """A hand that moves on at one speed, whatever it feels, and in the end stays."""

    def __init__(self, speed: float, depth: float) -> None:
        self._speed, self._depth = speed, depth

    def reset(self) -> None:
        pass

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        position = self._speed * t_s
        moving = position < self._depth
        return min(position, self._depth), self._speed if moving else 0.0


@pytest.mark.parametrize(
    ("speed", "round_trip_ms"),
    [
        *((0.05, trip) for trip in ROUND_TRIPS_MS),
        *((speed, trip) for speed in (0.01, 0.1) for trip in (0.0, 150.0, 1000.0)),
    ],
)
def test_the_environment_is_never_pressed_beyond_the_cap_nor_energy_beyond_the_budget(
    speed: float, round_trip_ms: float
) -> None:
    environment = "stiff" if speed > 0.01 else "silicone"
    depth = 0.0083 + speed * (round_trip_ms * 1e-3 + 0.4)
    cell = Cell("model-mediated", environment, round_trip_ms, 0.0, 1)
    world = World(cell, operator=Relentless(speed, depth))
    left = round(depth / speed * 1e3 + 5 * round_trip_ms + 500)
    adoption = world.master.adoption
    try:
        while left > 0:
            world.step()
            left -= 1
            if adoption.newest.k > 1000.0:  # its consequences show within a round trip
                left = min(left, round(round_trip_ms) + 500)
            assert world.axis.force_max <= FORCE_CAP_N
            assert adoption.tank.level_J >= 0.0
    finally:
        world.close()
    assert world.axis.force_max > 1.0
    if environment == "stiff":
        end = world.axis.material.force(world.axis.position - SURFACE_M, world.axis.velocity)
        # Where the slave measured the wall's slope in motion, its damping counts as stiffness.
        in_motion = world.axis.material.b * speed / FORCE_CAP_N
        assert 0.99 - in_motion < end / (DEPTH_SHARE * FORCE_CAP_N) < 1.02
    assert adoption.newest.k > 1000.0, "the model was adopted"
    assert world.master.observer.lowest_J >= -world.master.observer.epsilon_J


def test_without_a_model_too_the_tool_presses_up_to_the_share_of_the_cap_and_no_further() -> None:
    world = World(Cell("direct", "stiff", 0.0, 0.0, 1), operator=Relentless(0.05, 0.03))
    try:
        for _ in range(700):
            world.step()
        pressed = world.axis.force_max
        world.axis.force_max = 0.0
        for _ in range(100):
            world.step()
    finally:
        world.close()
    share = DEPTH_SHARE * FORCE_CAP_N
    assert [pressed, world.axis.force_max] == pytest.approx([share, share], rel=0.02)


TURN_S = 2 * PERIOD_S + 2 / (2 * math.pi * DRIVE_HZ)
"""Time until the first sample arrives, one tick each way, and the drive's lag of 2/omega."""
CALM_TICKS = 40


@pytest.mark.parametrize(
    ("speed", "round_trip_ms"), [(0.01, 0.0), *((0.05, trip) for trip in ROUND_TRIPS_MS)]
)
def test_a_wall_that_stiffens_under_a_deep_tool_is_left_at_once(
    speed: float, round_trip_ms: float
) -> None:
    """Foam turns into silicone while the hand presses on: the force that finds the tool, no more.

    At the slow speed that is below the cap, and stays so; at the fast one it is above.
    """
    cell = Cell("model-mediated", "foam", round_trip_ms, 0.0, 1)
    world = World(cell, operator=Relentless(speed, 10.0))
    after = MATERIALS["silicone"][0]
    depth = 0.006 if speed < 0.02 else 0.013
    forces = []
    try:
        while world.axis.position < SURFACE_M + depth:
            world.step()
        found = float(after.force(world.axis.position - SURFACE_M, world.axis.velocity))
        # A critically damped drive lags by 2/omega: so it is driven where it lags by more.
        driven = math.pi * DRIVE_HZ * (world.axis.reference - world.axis.position)
        going_in = max(0.0, world.axis.velocity, driven)
        world.axis.material, world.axis.force_max = after, 0.0
        for _ in range(800):
            world.axis.force_max = 0.0
            world.step()
            forces.append(world.axis.force_max)
    finally:
        world.close()
    assert (found > FORCE_CAP_N) == (speed > 0.02)
    assert max(forces) <= max(FORCE_CAP_N, found + after.k * going_in * TURN_S)
    assert max(forces[CALM_TICKS:]) <= FORCE_CAP_N
    assert forces[-1] > 0.25 * FORCE_CAP_N, "it goes on pressing"
