"""First contact under delay with the real slave, estimators and link, on an ideal axis."""

from __future__ import annotations

import pytest

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


@pytest.mark.parametrize("round_trip_ms", ROUND_TRIPS_MS)
@pytest.mark.parametrize("speed", [0.01, 0.05, 0.1])
def test_the_environment_is_never_pressed_beyond_the_cap_nor_energy_beyond_the_budget(
    speed: float, round_trip_ms: float
) -> None:
    environment = "stiff" if speed > 0.01 else "silicone"
    world = World(Cell("model-mediated", environment, round_trip_ms, 0.0, 1))
    depth = 0.0083 + speed * (round_trip_ms * 1e-3 + 0.4)
    world.master._operator = Relentless(speed, depth)
    ticks = round(depth / speed * 1e3 + 5 * round_trip_ms + 500)
    adoption = world.master.adoption
    try:
        for _ in range(ticks):
            world.step()
            assert world.axis.force_max <= FORCE_CAP_N
            assert adoption.tank.level_J >= 0.0
    finally:
        world.close()
    assert world.axis.force_max > 1.0
    assert adoption.newest.k > 1000.0, "the model was adopted"
    assert world.master.observer.lowest_J >= -world.master.observer.epsilon_J
