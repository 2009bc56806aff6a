"""The same hand against an ideal continuous wall: what of a motion is the hand's own.

The wall is the environment's true law, in front of the device itself: no sampling, no latency, no
model. Device and hand are two masses with a stiff grip between them, as the campaign defines them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config import TrialConfig
from teleop_rt.config_operator import DeviceOperator
from teleop_rt.master.hand import Hand

Array = NDArray[np.float64]
GRIP_STIFFNESS, GRIP_DAMPING, STEPS = 5.0e4, 60.0, 50


def ideal_motion(trial: TrialConfig) -> tuple[Array, Array]:
    """Return position and wall force (n,) of every period of a trial."""
    operator = trial.operator
    assert isinstance(operator, DeviceOperator)
    assert operator.hand is not None
    hand, body, wall = operator.hand, operator.plant or operator.body, trial.plant.environment
    period_s = 1.0 / trial.master.rate_hz
    wishes = Hand(hand, period_s, np.random.default_rng(trial.seed))
    x = y = hand.intention.start
    v = w = force = 0.0
    h, rows = period_s / STEPS, []
    for tick in range(1, round(trial.duration_s / period_s) + 1):
        wish = wishes.intend(tick * period_s, force)
        held_on = hand.let_go_s is None or tick * period_s < hand.let_go_s
        for step in range(STEPS):
            goal = wish.goal - wish.rate * (period_s - step * h)
            depth = x - wall.surface
            force = max(0.0, wall.stiffness * depth + wall.damping * v) if depth > 0 else 0.0
            held = (GRIP_STIFFNESS * (y - x) + GRIP_DAMPING * (w - v)) if held_on else 0.0
            arm = wish.grip * (hand.stiffness * (goal - y) + hand.damping * (wish.rate - w))
            friction = body.damping * v + body.coulomb_friction * np.tanh(v / 1e-3)
            v += h / body.mass * (held - force - friction)
            w += h / hand.mass * (arm * held_on + wish.tremor - held)
            x, y = x + h * v, y + h * w
        rows.append((x, force))
    position, felt = np.array(rows).T
    return position, felt
