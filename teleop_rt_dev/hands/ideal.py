"""The same hand against ideal continuous walls: the hand's own part of a motion.

One wall is the environment's true law, in front of the device itself: no sampling, no latency, no
model. Where a device renders a wall softer, a tremor moves the hand further, whoever renders it; so
the other is a spring of the rendered stiffness at the true surface, that moves as it does. Device
and hand are two masses with a stiff grip between them, as the campaign defines them.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.trial import TrialConfig
from teleop_rt.master.hand import Hand

Array = NDArray[np.float64]
GRIP_STIFFNESS, GRIP_DAMPING, STEPS = 5.0e4, 60.0, 50


class ContinuousWall(Protocol):
    """A wall in front of a hand, without sampling or latency."""

    def force(self, x: float, v: float, t_s: float) -> float:
        """Return the force at a position, velocity and time; times never go back."""


class IdealWall:
    """Linear, of Hunt and Crossley, stiffening, layered or moving, as a trial's plant says.

    With `stiffness` it is a spring alone, at the same surface.
    """

    def __init__(self, plant: Any, stiffness: float | None = None) -> None:
        self._body = plant.environment
        self.stiffness = stiffness
        hidden = {one.effect: one for one in plant.undeclared}
        self._foam = hidden.get("nonlinear_stiffening")
        self._layer = hidden.get("second_layer")
        self._motion = hidden.get("moving_surface")

    @property
    def fastest(self) -> float:
        """The largest speed of the surface."""
        move = self._motion
        return 0.0 if move is None else abs(move.velocity) + self._angular * move.swing

    @property
    def _angular(self) -> float:
        return 2 * math.pi * self._motion.swing_hz if self._motion else 0.0

    def moved(self, t_s: float) -> float:
        """Return how far the surface has moved by itself."""
        move = self._motion
        if move is None:
            return 0.0
        return float(move.velocity * t_s + move.swing * math.sin(self._angular * t_s))

    def force(self, x: float, v: float, t_s: float) -> float:
        """Return the force at a position, velocity and time."""
        body, move = self._body, self._motion
        x -= body.surface + self.moved(t_s)
        if move is not None:
            v -= move.velocity + move.swing * self._angular * math.cos(self._angular * t_s)
        if x <= 0.0:
            return 0.0
        if self.stiffness is not None:
            return self.stiffness * x
        power = body.hunt_crossley
        share = 1.0 if power is None else (x / power.depth) ** (power.exponent - 1)
        damping = body.damping * (1.0 if power is None else share * x / power.depth)
        force = body.stiffness * share * x + damping * v
        if self._foam is not None:
            depth = min(x, 0.98 * self._foam.locking_depth)
            force += self._foam.stiffness * depth**2 / (self._foam.locking_depth - depth)
        if self._layer is not None:
            force += self._layer.stiffness * max(0.0, x - self._layer.depth)
        return max(0.0, float(force))


def ideal_motion(
    trial: TrialConfig, wall: ContinuousWall, way: Array | None = None
) -> tuple[Array, Array]:
    """Return position and wall force (n,) of every period of a trial, in front of a wall.

    `way` (m, 2) are the positions and velocities that the device takes in the first periods; the
    hand goes with it, and grips it as before.
    """
    operator = trial.operator
    assert isinstance(operator, DeviceOperator)
    assert operator.hand is not None
    hand, body = operator.hand, operator.plant or operator.body
    period_s = 1.0 / trial.master.rate_hz
    wishes = Hand(hand, period_s, np.random.default_rng(trial.seed))
    x = y = hand.intention.start
    v = w = force = 0.0
    h, rows = period_s / STEPS, []
    # Every value stays a plain float: arithmetic on numpy's scalars takes several times as long.
    of_device, of_hand, dry = h / body.mass, h / hand.mass, body.coulomb_friction
    stiffness, damping, viscous = hand.stiffness, hand.damping, body.damping
    wall_force = wall.force
    taken = [] if way is None else way.tolist()
    for tick in range(1, round(trial.duration_s / period_s) + 1):
        wish = wishes.intend(tick * period_s, force)
        held_on = hand.let_go_s is None or tick * period_s < hand.let_go_s
        end, rate, grip, tremor = wish.goal, wish.rate, wish.grip, wish.tremor
        begins_s = (tick - 1) * period_s
        for step in range(STEPS):
            goal = end - rate * (period_s - step * h)
            force = wall_force(x, v, begins_s + step * h)
            held = (GRIP_STIFFNESS * (y - x) + GRIP_DAMPING * (w - v)) if held_on else 0.0
            arm = grip * (stiffness * (goal - y) + damping * (rate - w))
            friction = viscous * v + dry * math.tanh(v / 1e-3)
            v += of_device * (held - force - friction)
            w += of_hand * (arm * held_on + tremor - held)
            x, y = x + h * v, y + h * w
        if tick <= len(taken):
            (at, speed), dx, dv = taken[tick - 1], y - x, w - v
            x, v, y, w = at, speed, at + dx, speed + dv
        rows.append((x, force))
    position, felt = np.array(rows).T
    return position, felt
