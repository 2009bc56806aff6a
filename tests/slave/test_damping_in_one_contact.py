"""The felt damping of an environment within one long contact."""

from __future__ import annotations

import math

import numpy as np
import pytest

from teleop_rt.study.delay_plant import MATERIALS
from teleop_rt.study.delay_world import Cell, World


class HoldThenMove:
    """A hand that feels the wall, goes on a little, rests there, then presses deeper and moves.

    Where it stopped at once, the slave would rest with less force than that of an onset.
    """

    HOLD_S, SPEED, DEPTH, SWING, HERTZ = 1.0, 0.03, 0.004, 0.002, 2.0
    GOES_ON_S = 0.05

    def __init__(self) -> None:
        self.felt_s: float | None = None

    def reset(self) -> None:
        self.felt_s = None

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        if self.felt_s is None and felt_force > 0.5:
            self.felt_s = t_s
        if self.felt_s is None:
            return self.SPEED * t_s, self.SPEED
        if t_s < self.felt_s + self.GOES_ON_S:
            return self.SPEED * t_s, self.SPEED
        moving_s = t_s - self.felt_s - self.HOLD_S
        pressed = self.SPEED * (self.felt_s + self.GOES_ON_S)
        if moving_s <= 0.0:
            return pressed, 0.0
        ramp = min(1.0, moving_s / 0.5)
        omega = 2 * math.pi * self.HERTZ
        swing = self.SWING * math.sin(omega * moving_s)
        rate = self.SWING * omega * math.cos(omega * moving_s) * ramp
        rate += (self.DEPTH + swing) / 0.5 if ramp < 1.0 else 0.0
        return pressed + ramp * (self.DEPTH + swing), rate


@pytest.mark.parametrize("environment", ["foam", "silicone"])
def test_a_better_damping_is_adopted_within_one_contact_and_the_hand_stays_on_the_wall(
    environment: str,
) -> None:
    round_trip_ms = 700.0
    hand = HoldThenMove()
    world = World(Cell("model-mediated", environment, round_trip_ms, 0.0, 1), operator=hand)
    true = MATERIALS[environment][0]
    walls, forces, contacts = [], [], []
    try:
        while hand.felt_s is None or len(walls) < 3500 + 2 * round_trip_ms:
            world.step()
            if hand.felt_s is not None:
                walls.append(world.master.adoption.newest)
                forces.append(world.master.force)
                contacts.append(world.slave.contact.contact_id)
    finally:
        world.close()
    rest = round(1e3 * hand.HOLD_S)
    first = next(wall for wall in walls if wall.k > 0.5 * true.k)
    assert abs(first.b - true.b) > 1.5 * abs(walls[-1].b - true.b), "the first touch shows less"
    assert walls[-1].b == pytest.approx(true.b, rel=0.15)
    assert walls[-1].k == pytest.approx(true.k, rel=0.05)
    assert len(set(contacts[rest:])) == 1
    assert np.min(forces) > 0.0, "the hand never left the wall"
