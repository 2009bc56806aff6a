"""Passivity of the rendered port: a bound before the fact, an observer and a controller after.

A wall of stiffness K and damping B, sampled with period T behind a differentiator and a delay,
is passive for every hand if the device's own damping exceeds (Colgate and Schenkel 1997)

    sup over ω of (T/2)/(1 - cos ωT) · Re{(1 - e^{-jωT}) H(e^{jωT})},  H = (K + B D) e^{-jωτ}.

That holds where velocity is computed from sampled positions. A velocity that the device
measures is a sample of its own, and tones above π/T alias into it; for each tone alone the hand
then needs

    sup over all ω of T/(ωT)² · Re{(1 - e^{-jωT}) H(jω)},  D = jω,

which is K T/2 for a spring and 0.217 B for a damper. Both are linear in K and B, so their curves
are computed once. A blend of walls that satisfy them satisfies them too.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from teleop_rt.master.rendered_effects import Term
from teleop_rt.master.walls import Wall

VelocitySource = Literal["measured", "difference"]
GRID_POINTS = 1024
_REDUCTIONS, _ALMOST = 60, 0.999
LOWEST_TONE, HIGHEST_TONE = 1e-3, 3 * np.pi
"""The tones [rad per period] that are looked at; above, the weight of aliases only falls."""


@dataclass(frozen=True, slots=True)
class Port:
    """How the device senses and how it is driven.

    `velocity` is "measured" where the device gives it (an ideal device), or "difference" for a
    backward difference, behind a first-order low-pass of `cutoff_hz` if that is above 0.
    `delay_s` is the delay of computation and sensing; `position_scale` and `force_scale` are
    the factors from hand to wall and from wall to hand.
    """

    period_s: float
    damping: float
    velocity: VelocitySource = "measured"
    cutoff_hz: float = 0.0
    delay_s: float = 0.0
    position_scale: float = 1.0
    force_scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the bound says of a wall: largest local K and B, true and as rendered."""

    true_stiffness: float = 0.0
    true_damping: float = 0.0
    rendered_stiffness: float = 0.0
    rendered_damping: float = 0.0
    required_damping: float = 0.0

    @property
    def reduced(self) -> bool:
        """Whether the wall is rendered softer or less damped than it is."""
        return (self.rendered_stiffness, self.rendered_damping) != (
            self.true_stiffness,
            self.true_damping,
        )


class PassivityBound:
    """The damping that a device needs to render K and B, and the reduction where it lacks it."""

    def __init__(self, port: Port) -> None:
        self._available = port.damping
        self._per_stiffness, self._per_damping = _curves(port)

    @property
    def stiffness_max(self) -> float:
        """The stiffest wall without damping that the device can render."""
        return float(self._available / self._per_stiffness.max())

    def required_damping(self, stiffness: float, damping: float) -> float:
        """Return the damping that the device must have for every B between 0 and `damping`."""
        elastic = stiffness * self._per_stiffness
        return float(max(elastic.max(), (elastic + damping * self._per_damping).max()))

    def reduce(self, stiffness: float, damping: float) -> tuple[float, float]:
        """Return the largest rendered K and B: B is reduced first, K where that is not enough."""
        needed = self.required_damping(stiffness, 0.0)
        if needed > self._available:
            stiffness *= self._available / needed
        room = self._available - stiffness * self._per_stiffness
        rising = self._per_damping > 0
        if damping > 0 and rising.any():
            largest = float((room[rising] / self._per_damping[rising]).min())
            damping = min(damping, max(0.0, largest))
        return stiffness, damping


def _curves(port: Port) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the required damping over frequency per unit of K and per unit of B."""
    measured = port.velocity == "measured"
    highest = HIGHEST_TONE if measured else np.pi
    theta = np.geomspace(LOWEST_TONE, highest, GRID_POINTS)
    back = np.exp(-1j * theta)
    omega = theta / port.period_s
    differentiator = 1j * omega if measured else (1 - back) / port.period_s
    if port.cutoff_hz > 0:
        pole = np.exp(-2 * np.pi * port.cutoff_hz * port.period_s)
        differentiator = differentiator * (1 - pole) / (1 - pole * back)
    gain = port.position_scale * port.force_scale * np.exp(-1j * omega * port.delay_s)
    weight = port.period_s / theta**2 if measured else port.period_s / 2 / (1 - np.cos(theta))
    share = weight * (1 - back) * gain
    return share.real, (share * differentiator).real


def largest_slopes(wall: Wall, force_max: float, velocity_max: float) -> tuple[float, float]:
    """Return the largest ∂f/∂x and ∂f/∂ẋ of a wall up to the depth where it gives `force_max`.

    Effects beside it add theirs, which may not help each other.
    """
    stiffness, damping = _slopes_of_model(wall, force_max, velocity_max)
    if wall.terms:
        depth = wall.position_of(force_max) - wall.surface_now
        for term in wall.terms:
            if not term.memory.moves:
                by_depth, by_speed = term.slope(depth)
                stiffness += by_depth
                damping += by_speed
    return stiffness, damping


def _slopes_of_model(wall: Wall, force_max: float, velocity_max: float) -> tuple[float, float]:
    if wall.k <= 0 or (wall.n == 1 and not wall.damping_power):
        return wall.k, wall.b
    depth = (force_max / wall.k) ** (1 / wall.n)
    stiffness = wall.n * wall.k * depth ** (wall.n - 1)
    if wall.damping_power:
        p = wall.damping_power
        stiffness += p * wall.b * depth ** (p - 1) * velocity_max
    return stiffness, wall.b * depth**wall.damping_power


class WallLimiter:
    """Reduces walls to what the port renders passively, and keeps the verdict on the last."""

    def __init__(self, port: Port, force_max: float, velocity_max: float) -> None:
        self._bound = PassivityBound(port)
        self._force_max = force_max
        self._velocity_max = velocity_max
        self.reset()

    def reset(self) -> None:
        """Forget the verdict."""
        self.verdict = Verdict()

    @property
    def stiffness_max(self) -> float:
        """The stiffest wall without damping that can be rendered, known before any wall is."""
        return self._bound.stiffness_max

    def apply(self, wall: Wall) -> Wall:
        """Return the wall as it may be rendered: the same, or softer and less damped."""
        stiffness, damping = largest_slopes(wall, self._force_max, self._velocity_max)
        rendered_stiffness, rendered_damping = self._bound.reduce(stiffness, damping)
        self.verdict = Verdict(
            stiffness,
            damping,
            rendered_stiffness,
            rendered_damping,
            self._bound.required_damping(stiffness, damping),
        )
        if not self.verdict.reduced:
            return wall
        if wall.terms:
            return self._reduced_with_effects(wall)
        # A softer wall reaches force_max deeper, where its slopes are larger: hence the powers.
        softer = rendered_stiffness / stiffness if stiffness > 0 else 1.0
        calmer = rendered_damping / damping if damping > 0 else 1.0
        return replace(
            wall, k=wall.k * softer**wall.n, b=wall.b * calmer * softer**wall.damping_power
        )

    def _reduced_with_effects(self, wall: Wall) -> Wall:
        """Return the wall with its slopes reduced until they are within the bound: effects first.

        Their largest slopes lie at a speed or depth that the hand hardly reaches, while the
        model's own act all the time.
        """
        for _ in range(_REDUCTIONS):
            stiffness, damping = largest_slopes(wall, self._force_max, self._velocity_max)
            soft, calm = self._bound.reduce(stiffness, damping)
            if soft >= _ALMOST * stiffness and calm >= _ALMOST * damping:
                break
            own_k, own_b = _slopes_of_model(wall, self._force_max, self._velocity_max)
            of_k, of_springs = _shared_out(soft, own_k, stiffness)
            of_b, of_dampers = _shared_out(calm, own_b, damping)
            depth = wall.position_of(self._force_max) - wall.surface_now
            terms = tuple(_eased(term, depth, of_springs, of_dampers) for term in wall.terms)
            wall = replace(wall, k=of_k * wall.k, b=of_b * wall.b, terms=terms)
        self.verdict = replace(
            self.verdict,
            rendered_stiffness=min(soft, stiffness),
            rendered_damping=min(calm, damping),
        )
        return wall


def _shared_out(allowed: float, own: float, total: float) -> tuple[float, float]:
    """Return the factors of a model's own slope and of its effects' that make the allowed total."""
    if allowed >= total:
        return 1.0, 1.0
    if allowed >= own:
        return 1.0, (allowed - own) / (total - own)
    return allowed / own, 0.0


def _eased(term: Term, depth: float, of_springs: float, of_dampers: float) -> Term:
    """Return an effect's share of the reduction: as a spring, a damper, or both.

    A damper is left as it is for a slow hand.
    """
    if term.memory.moves:
        return term
    by_depth, by_speed = term.slope(depth)
    if of_dampers < 1.0 and by_speed > 0.0 and term.memory.damps:
        term, of_dampers = term.calmed(depth, of_dampers), 1.0
    factor = min(of_springs if by_depth > 0 else 1.0, of_dampers if by_speed > 0 else 1.0)
    return replace(term, amplitude=factor * term.amplitude)


class PassivityObserver:
    """Observes the energy that the hand gives to the port, and damps what is too little.

    E = Σ (f Δx + b_device v Δx), with the force held over the tick (Hannaford and Ryu 2002).
    Passive rendering keeps E >= -ε with ε the tank's capacity plus its allowance so far, which
    is the energy that adoptions may spend. Below that, the controller adds damping, at most the
    device's own, until the deficit is paid, unless it is told to observe alone (`damps`).
    """

    def __init__(
        self, device_damping: float, capacity_J: float, allowance_W: float, *, damps: bool = True
    ) -> None:
        self._damping = device_damping
        self._damps = damps
        self._capacity_J = capacity_J
        self._allowance_W = allowance_W
        self.reset()

    def reset(self) -> None:
        """Start observing anew."""
        self.energy_J = 0.0
        self.lowest_J = 0.0
        self.epsilon_J = self._capacity_J
        self.injected_J = 0.0
        self._position: float | None = None
        self._force = 0.0

    def update(self, position: float, velocity: float, force: float, dt_s: float) -> float:
        """Take in one tick of the hand's own position; return the force, damped if need be."""
        if self._position is not None:
            travelled = position - self._position
            self.energy_J += (self._force + self._damping * velocity) * travelled
        self._position = position
        self.epsilon_J += self._allowance_W * dt_s
        self.lowest_J = min(self.lowest_J, self.energy_J)
        deficit_J = -self.epsilon_J - self.energy_J
        power_per_damping = velocity * velocity * dt_s
        if self._damps and deficit_J > 0 and power_per_damping > 0:
            injected = min(self._damping, deficit_J / power_per_damping)
            self.injected_J += injected * power_per_damping
            force += injected * velocity
        self._force = force
        return force
