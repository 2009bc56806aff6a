from __future__ import annotations

import numpy as np
import pytest
from master_world import PERIOD_NS, World

from teleop_rt.config import ProfileOperator
from teleop_rt.link.impairment import Impairment
from teleop_rt.master.operators import Profile
from teleop_rt.signals import MASTER, columns

COLUMN = columns(MASTER)
PROFILE = ProfileOperator(
    kind="profile",
    approach_speed=0.04,
    mean=0.012,
    amplitude=0.008,
    frequency_hz=3.0,
    felt_force=0.5,
    lift_off_height=0.005,
)


def true_force(world: World, rows: np.ndarray) -> np.ndarray:
    """The wall's force at the master's own motion, written here from (2.1)."""
    x = rows[:, COLUMN["target"]] - world.slave.surface
    v = rows[:, COLUMN["velocity"]]
    return np.where(x > 0, np.maximum(0.0, world.slave.k * x + world.slave.b * v), 0.0)


@pytest.mark.parametrize("round_trip_ms", [0, 150, 1000])
@pytest.mark.parametrize("model_after", [0, 20])
def test_rendered_force_is_the_walls_force_at_the_hands_own_motion(
    round_trip_ms: int, model_after: int
) -> None:
    delay = Impairment(delay_ns=round_trip_ms * PERIOD_NS // 2)
    world = World(Profile(PROFILE), there=delay, model_after=model_after)
    world.run(4 * round_trip_ms + 1500)
    rows = world.run(9000)
    expected = true_force(world, rows)
    assert expected.max() > 50.0
    np.testing.assert_allclose(rows[:, COLUMN["rendered_force"]], expected, atol=1e-9)
