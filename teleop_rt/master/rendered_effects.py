"""Effects of the environment under the operator's hand: their memories, values and slopes.

The slave streams which effects lie beside the model, how much of each and their shapes; here they
are evaluated at the hand's own motion, so the force they make lags no more than the wall's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from teleop_rt.contact.effect import Effect, Vector
from teleop_rt.contact.fitted import at_rest, code_of, slopes
from teleop_rt.contact.law import touches
from teleop_rt.link.messages import ModelEffect

_GRID = 48
"""Depths at which an effect's force is tabulated."""
_STEP_S = 1e-3
"""Step of an effect that is asked at rest; its state is not advanced by it."""
_HALVINGS, _SLOWEST = 20, 1e-6
"""Steps of the bisection for a speed, and the least speed of a slope [rig unit/s]."""
_SHARES = (0.05, 0.25, 0.5, 0.75, 1.0)
"""Shares of a depth at which the slope of a damper is evaluated."""
_ENERGY_POINTS, _ENERGY_WEIGHTS = np.polynomial.legendre.leggauss(6)


@dataclass(slots=True)
class EffectMemory:
    """One effect with its shape, as the hand's motion has led it: value now, and value at rest.

    `value` is per unit amplitude at the hand; `elastic` the part of it that a spring keeps.
    """

    effect: Effect
    eta: Vector
    state: Vector
    value: float = 0.0
    elastic: float = 0.0
    depth: float = 0.0
    velocity: float = 0.0
    time_s: float = 0.0
    speed: float = 0.0
    depths: Vector = field(default_factory=lambda: np.zeros(0))
    stiffness: Vector = field(default_factory=lambda: np.zeros(0))
    damping: Vector = field(default_factory=lambda: np.zeros(0))

    @property
    def moves(self) -> bool:
        """Whether it moves the surface rather than adds a force."""
        return self.effect.acts == "moves_position"

    @property
    def in_contact(self) -> bool:
        """Whether it acts in contact alone; one that acts outside, too, may pull."""
        return self.effect.only_in_contact

    def advance(self, depth: float, velocity: float, t_s: float, dt_s: float) -> None:
        """Follow the hand by one tick to a depth."""
        self.depth, self.velocity, self.time_s = depth, velocity, t_s
        if self.in_contact and not touches(depth) and not self.effect.state_size:
            self.value = self.elastic = 0.0
            return
        self.value = self.effect.step(self.state, depth, velocity, 0.0, t_s, dt_s, self.eta)
        self.elastic = self.value
        if not self.effect.state_size and self.effect.derivative_order:
            self.elastic = self.effect.step(self.state, depth, 0.0, 0.0, t_s, dt_s, self.eta)

    @property
    def damps(self) -> bool:
        """Whether it depends on the speed of the hand, without a memory."""
        return bool(self.effect.derivative_order) and not self.effect.state_size

    def value_up_to(self, speed: float) -> float:
        """Return the value at the hand if its speed were no larger than this."""
        if not self.damps or abs(self.velocity) <= speed or self.value == 0.0:
            return self.value
        slower = math.copysign(speed, self.velocity)
        return self.effect.step(self.state, self.depth, slower, 0.0, self.time_s, _STEP_S, self.eta)

    def value_at(self, depth: float) -> float:
        """Return the spring's part at a depth other than the hand's; memory stays as it is."""
        if self.effect.state_size:
            return self.elastic
        return at_rest(self.effect, self.eta, depth) if touches(depth) else 0.0

    def energy(self, depth: float) -> float:
        """Return the energy per unit amplitude: in a spring of the depth, or an internal one.

        An internal spring of the quick stiffness s holds z^2 / (2 s) at the force z.
        """
        if not touches(depth) or self.moves:
            return 0.0
        if self.effect.state_size:
            quick = self.slope(depth)[0]
            return 0.5 * self.elastic * abs(self.elastic) / quick if quick > 0.0 else 0.0
        half = 0.5 * depth
        points = half * (1.0 + _ENERGY_POINTS)
        values = [at_rest(self.effect, self.eta, float(x)) for x in points]
        return half * float(_ENERGY_WEIGHTS @ np.array(values))

    def tabulate(self, deepest: float, speed: float) -> None:
        """Compute the largest slopes up to each depth of a grid, once for all."""
        self.speed = speed
        self.depths = deepest * np.arange(1.0, _GRID + 1.0) / _GRID
        found = [slopes(self.effect, self.eta, float(x), speed) for x in self.depths]
        self.stiffness, self.damping = np.maximum.accumulate(np.array(found)).T

    def slope(self, depth: float) -> tuple[float, float]:
        """Return the largest |df/dx| and |df/dv| per unit amplitude up to a depth."""
        stiffness = float(np.interp(depth, self.depths, self.stiffness))
        return stiffness, float(np.interp(depth, self.depths, self.damping))


@dataclass(frozen=True, slots=True)
class RenderedEffect:
    """An effect beside a wall: how much of it.

    Of an effect that damps, a hand faster than `speed` feels the force at that speed: its slope is
    bounded, and slower motion is rendered as it is.
    """

    memory: EffectMemory
    amplitude: float
    speed: float = math.inf

    @property
    def force(self) -> float:
        """The force that it adds at the hand."""
        if math.isinf(self.speed):
            return self.amplitude * self.memory.value
        return self.amplitude * self.memory.value_up_to(self.speed)

    def slope(self, depth: float) -> tuple[float, float]:
        """Return the largest |df/dx| and |df/dv| up to a depth."""
        size = abs(self.amplitude)
        by_depth, by_speed = self.memory.slope(depth)
        if math.isfinite(self.speed):
            by_speed = min(by_speed, self._up_to(depth, self.speed))
        return size * by_depth, size * by_speed

    def calmed(self, depth: float, factor: float) -> RenderedEffect:
        """Return the term with its largest |df/dv| up to a depth reduced by a factor below 1."""
        _, by_speed = self.slope(depth)
        allowed = factor * by_speed / abs(self.amplitude)
        low, high = 0.0, min(self.speed, self.memory.speed)
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self._up_to(depth, middle) <= allowed else (low, middle)
        slower = replace(self, speed=low)
        if slower.slope(depth)[1] <= factor * by_speed:
            return slower
        return replace(self, amplitude=factor * self.amplitude)

    def _up_to(self, depth: float, speed: float) -> float:
        """Return the largest |df/dv| per unit amplitude up to a depth and a speed."""
        memory = self.memory
        return max(
            slopes(memory.effect, memory.eta, share * depth, max(speed, _SLOWEST))[1]
            for share in _SHARES
        )


class RenderedEffects:
    """The memories of all effects that a slave has streamed, and the time they see.

    Compiled at the start for all effects that may come: `library`.
    """

    def __init__(self, library: Sequence[Effect], deepest: float, speed: float) -> None:
        self._known = {
            code_of(effect): effect for effect in library if effect.belongs_to == "environment"
        }
        self._deepest, self._speed = deepest, speed
        self._memories: dict[tuple[int, tuple[float, ...]], EffectMemory] = {}
        self._time_s = 0.0
        self._timed = False
        for effect in self._known.values():
            eta = np.array([shape.start for shape in effect.shapes] or [0.0])
            effect.step(np.zeros(max(1, effect.state_size)), 0.0, 0.0, 0.0, 0.0, 1e-3, eta)

    def reset(self) -> None:
        """Forget every effect."""
        self._memories.clear()
        self._timed = False

    def terms(
        self, streamed: Sequence[ModelEffect], time_s: float
    ) -> tuple[RenderedEffect, ...] | None:
        """Return the terms of a streamed model, None where an effect is not known here.

        `time_s` is the time that the slave's effects see; the first one counts.
        """
        if any(one.code not in self._known for one in streamed):
            return None
        if streamed and not self._timed:
            self._time_s, self._timed = time_s, True
        return tuple(RenderedEffect(self._memory(one), one.amplitude) for one in streamed)

    def advance(self, position: float, surface: float, velocity: float, dt_s: float) -> None:
        """Follow the hand by one tick, at a position against the newest wall's surface."""
        self._time_s += dt_s
        for memory in self._memories.values():
            memory.advance(position - surface, velocity, self._time_s, dt_s)

    def _memory(self, one: ModelEffect) -> EffectMemory:
        key = (one.code, one.shape)
        if key not in self._memories:
            effect = self._known[one.code]
            eta = np.array(one.shape)  # a law reads as many as it has
            memory = EffectMemory(effect, eta, np.zeros(max(1, effect.state_size)))
            memory.tabulate(self._deepest, self._speed)
            self._memories = {key: memory} | {
                k: m for k, m in self._memories.items() if k[0] != one.code
            }
        return self._memories[key]
