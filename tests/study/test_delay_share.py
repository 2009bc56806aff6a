"""Why direct reflection of the stiff wall is unstable in full: its lag, without the study.

The loop as a linear map of one tick: hand, force held over the tick, drive, a wall on both sides.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from teleop_rt.study.delay_plant import DRIVE_HZ, MATERIALS, PERIOD_S, EnvironmentName, Material
from teleop_rt.study.delay_world import hand_config

HAND = hand_config()
LOOSEST = 1 - HAND.grip_change
SUBSTEPS = 8


def after_a_tick(state: np.ndarray, wall: Material, share: float, drive_hz: float) -> np.ndarray:
    """Advance hand (x, v), force held, drive (p, q), its reference and the target on its way."""
    x, v, held, p, q, reference, target = state
    omega = 2 * math.pi * drive_hz
    error, decay = p - reference, math.exp(-omega * PERIOD_S)
    rate = q + omega * error
    p, q = reference + (error + rate * PERIOD_S) * decay, (q - omega * rate * PERIOD_S) * decay
    for _ in range(SUBSTEPS):
        push = -LOOSEST * (HAND.stiffness * x + HAND.damping * v) - held
        v += push / HAND.mass * PERIOD_S / SUBSTEPS
        x += v * PERIOD_S / SUBSTEPS
    return np.array([x, v, share * (wall.k * p + wall.b * q), p, q, target, x])


def stable(share: float, wall: Material, drive_hz: float) -> bool:
    columns = [after_a_tick(one, wall, share, drive_hz) for one in np.eye(7)]
    return bool(np.abs(np.linalg.eigvals(np.array(columns).T)).max() < 1)


@pytest.mark.parametrize(
    ("environment", "drive_hz", "least", "most"),
    [
        ("foam", DRIVE_HZ, 1.0, math.inf),
        ("silicone", DRIVE_HZ, 1.0, math.inf),
        ("stiff", DRIVE_HZ, 0.4, 0.5),
        ("stiff", 4 * DRIVE_HZ, 0.7, 0.8),
    ],
)
def test_the_lag_of_drive_and_ticks_bounds_the_share_of_a_stiff_wall_that_is_stable(
    environment: EnvironmentName, drive_hz: float, least: float, most: float
) -> None:
    wall = MATERIALS[environment][0]
    assert stable(least, wall, drive_hz)
    assert math.isinf(most) or not stable(most, wall, drive_hz)
