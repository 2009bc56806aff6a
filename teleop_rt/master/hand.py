"""A simulated hand: it holds the device like a spring and pushes towards its intended motion."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from teleop_rt.config.operator import HandOperator
from teleop_rt.master.operators import Operator, Profile

_SUBSTEPS = 8
"""Steps of the hand's integration in a tick."""
_GRIP_TIME_S = 0.2
"""Time constant with which the grip follows its goal."""
_TREMOR_QUALITY = 5.0
"""Of the resonance that shapes the tremor: its width is a fifth of its frequency."""


class Wish(NamedTuple):
    """Where a hand wants to be and how fast, its tremor, and its share of the mean grip."""

    goal: float
    rate: float
    tremor: float
    grip: float
    elapsed_s: float


class Hand:
    """m ẍ = K_h (x_i - x) + B_h (ẋ_i - ẋ) - f + tremor, f held over a period.

    Spring and damper together give no more than `force_max`: however far an intention runs away,
    an adult pulls with 400 N and pushes with 250 N at most (B. Das and Y. Wang 2004, Int. J.
    Occupational Safety and Ergonomics 10(1), 43-58).

    The intention x_i is the profile's, or another operator's if one is given, which feels the
    force one reaction time late. Tremor is noise through a resonance of quality 5 at `tremor_hz`.
    At each change of grip K_h and B_h move to another share of their mean, with a time constant
    of 0.2 s. Deterministic for `rng`.
    """

    def __init__(
        self,
        config: HandOperator,
        period_s: float,
        rng: np.random.Generator,
        intention: Operator | None = None,
    ) -> None:
        self._config = config
        self._period_s = period_s
        self._rng = rng
        self._seed_state = rng.bit_generator.state
        self._intention = intention or Profile(config.intention)
        self._felt: deque[float] = deque(maxlen=1 + round(config.reaction_ms * 1e-3 / period_s))
        angle = 2 * math.pi * config.tremor_hz * period_s
        radius = math.exp(-angle / (2 * _TREMOR_QUALITY))
        self._tremor_a1, self._tremor_a2 = 2 * radius * math.cos(angle), -radius * radius
        self._tremor_gain = config.tremor * math.sqrt(
            (1 - radius**2)
            * (1 - 2 * radius**2 * math.cos(2 * angle) + radius**4)
            / (1 + radius**2)
        )
        self.reset()

    def reset(self) -> None:
        """Go back to rest at the start, with the same tremor and the same grips again."""
        self._rng.bit_generator.state = self._seed_state
        self._intention.reset()
        self._felt.clear()
        self._position, self._velocity = self._config.intention.start, 0.0
        self._tremor = self._tremor_before = 0.0
        self._grip = self._grip_goal = 1.0
        self._grip_due_s = self._config.grip_every_s
        self._t_s = 0.0

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:
        """Return position and velocity at `t_s`, the felt force held since the last call."""
        wish = self.intend(t_s, felt_force)
        if wish.elapsed_s > 0:
            self._move(wish, felt_force)
        return self._position, self._velocity

    def intend(self, t_s: float, felt_force: float) -> Wish:
        """Return the hand's intent at `t_s`, after a force felt since the last call."""
        self._felt.append(felt_force)
        goal, rate = self._intention.update(t_s, self._felt[0])
        elapsed_s, self._t_s = t_s - self._t_s, t_s
        if elapsed_s <= 0:
            return Wish(goal, rate, 0.0, self._grip, 0.0)
        self._regrip(t_s, elapsed_s)
        return Wish(goal, rate, self._shake(), self._grip, elapsed_s)

    def _move(self, wish: Wish, felt_force: float) -> None:
        stiffness, damping = self._config.stiffness * wish.grip, self._config.damping * wish.grip
        dt_s = wish.elapsed_s / _SUBSTEPS
        start = wish.goal - wish.rate * wish.elapsed_s
        for step in range(1, _SUBSTEPS + 1):
            goal = start + wish.rate * dt_s * step
            spring = stiffness * (goal - self._position)
            damper = damping * (wish.rate - self._velocity)
            if abs(spring + damper) > self._config.force_max:
                spring, damper = math.copysign(self._config.force_max, spring + damper), 0.0
            force = spring + wish.tremor - felt_force
            force += damper
            self._velocity += force / self._config.mass * dt_s
            self._position += self._velocity * dt_s

    def _shake(self) -> float:
        noise = self._tremor_gain * float(self._rng.standard_normal())
        shaken = self._tremor_a1 * self._tremor + self._tremor_a2 * self._tremor_before + noise
        self._tremor_before, self._tremor = self._tremor, shaken
        return shaken

    def _regrip(self, t_s: float, elapsed_s: float) -> None:
        if t_s >= self._grip_due_s:
            change = self._config.grip_change
            self._grip_goal = 1 + float(self._rng.uniform(-change, change))
            self._grip_due_s += self._config.grip_every_s
        self._grip += (self._grip_goal - self._grip) * min(1.0, elapsed_s / _GRIP_TIME_S)
