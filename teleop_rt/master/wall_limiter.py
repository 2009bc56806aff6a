"""Walls reduced to the passive range of a device: softer, less damped, or bent at a depth.

`passivity.PassivityBound` gives the range; this module reduces a wall beyond it, its power law and
the effects beside it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from teleop_rt.contact.law import spring_depth, spring_slope
from teleop_rt.master.passivity import PassivityBound, Port
from teleop_rt.master.rendered_effects import RenderedEffect
from teleop_rt.master.walls import Wall

_REDUCTIONS, _ALMOST = 60, 0.999
"""Reductions at most, and the share of the slopes from which the rest needs no other one."""
_LONGEST_TRAVEL = 10.0  # m or rad; a spring too soft to give its force there gives less
GRIP_SHARE = 0.8
"""Of the bound, for the spring of a brake: damping of twice the device's own friction fits beside
it, so that a hand that taps on the brake comes to rest; still softer, it throws a heavy hand back.
"""


@dataclass(frozen=True, slots=True)
class RenderedBound:
    """Largest local K and B of a wall, true and as the passivity bound lets them be rendered."""

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


def largest_slopes(wall: Wall, force_max: float, velocity_max: float) -> tuple[float, float]:
    """Return the largest ∂f/∂x and ∂f/∂ẋ of a wall up to the depth where it gives `force_max`.

    Effects beside it add theirs, which may not help each other.
    """
    stiffness, damping = _slopes_of_model(wall, force_max, velocity_max)
    damping += wall.calming
    if wall.terms:
        depth = wall.position_of(force_max) - wall.surface_now
        for term in wall.terms:
            if not term.memory.moves:
                by_depth, by_speed = term.slope(depth)
                stiffness += by_depth
                damping += by_speed
    return stiffness, damping


def _slopes_of_model(wall: Wall, force_max: float, velocity_max: float) -> tuple[float, float]:
    spring, of_damping, damping = _parts_of_model(wall, force_max, velocity_max)
    return spring + of_damping, damping


def _deepest(wall: Wall, force_max: float) -> float:
    """Return the depth at which the spring gives `force_max`, within any device's travel."""
    return min(spring_depth(force_max, wall.k, wall.n), _LONGEST_TRAVEL)


def _parts_of_model(
    wall: Wall, force_max: float, velocity_max: float
) -> tuple[float, float, float]:
    """Return the largest slopes of the spring, of the damping with depth, and with speed.

    They are found apart: beside a large damping, a difference would lose the spring's.
    """
    if wall.k <= 0 or (wall.n == 1 and not wall.damping_power):
        return wall.k, 0.0, wall.b
    depth = _deepest(wall, force_max)
    spring = min(wall.stiffest, spring_slope(depth, wall.k, wall.n))
    depth, p = min(depth, wall.damped_depth), wall.damping_power
    of_damping = p * wall.b * depth ** (p - 1) * velocity_max if p else 0.0
    return spring, of_damping, wall.b * depth**p


class WallLimiter:
    """Reduces walls to the port's passive range, and keeps the bound on the last."""

    def __init__(self, port: Port, force_max: float, velocity_max: float) -> None:
        self._port = port
        self._force_max = force_max
        self._velocity_max = velocity_max
        self.reset()

    def reset(self) -> None:
        """Forget the last wall, and trust the device again."""
        self.rendered_bound = RenderedBound()
        self.damping_room = 0.0
        self.trust(1.0)

    def trust(self, share: float) -> None:
        """Count on a share of the damping that the device says it has."""
        self._bound = PassivityBound(replace(self._port, damping=share * self._port.damping))

    @property
    def grip(self) -> tuple[float, float]:
        """Stiffness and damping of a brake that holds: softer than a wall, and well damped."""
        stiffness = GRIP_SHARE * self._bound.stiffness_max
        return stiffness, self._bound.damping_max(stiffness)

    @property
    def stiffness_max(self) -> float:
        """The stiffest wall without damping that can be rendered, known before any wall is."""
        return self._bound.stiffness_max

    def stiffness_max_later(self, later_s: float) -> float:
        """Return the stiffest wall whose force may come later than a rendered one's by so much."""
        return self._bound.stiffness_max_later(later_s)

    def apply(self, wall: Wall) -> Wall:
        """Return the wall as it may be rendered: the same, or softer and less damped."""
        if wall.damping_power and not wall.terms:
            return self._bent(wall)
        stiffness, damping = largest_slopes(wall, self._force_max, self._velocity_max)
        rendered_stiffness, rendered_damping = self._bound.reduce(stiffness, damping)
        calming = self._calming(stiffness, rendered_stiffness, rendered_damping)
        self._judge(stiffness, damping, rendered_stiffness, rendered_damping + calming)
        if not self.rendered_bound.reduced:
            return wall
        if wall.terms:
            return self._reduced_with_effects(wall)
        return replace(wall, k=rendered_stiffness, b=rendered_damping, calming=calming)

    def _calming(self, stiffness: float, rendered: float, damping: float) -> float:
        """Return the damping that a wall lacks against its spring's latency, as far as allowed."""
        lost = self._bound.lost_damping(stiffness)
        return max(0.0, min(lost, self._bound.damping_max(rendered)) - damping) if lost else 0.0

    def _judge(self, stiffness: float, damping: float, soft: float, calm: float) -> None:
        """Keep the true slopes and the rendered ones."""
        needed = self._bound.required_damping(stiffness, damping)
        self.rendered_bound = RenderedBound(stiffness, damping, soft, calm, needed)
        self.damping_room = self._bound.damping_max(soft) - calm

    def _bent(self, wall: Wall) -> Wall:
        """Return a Hunt-Crossley wall that is rendered as it is up to the slope of the bound.

        From there its spring is a straight line: scaled down as a whole, a wall that is stiff at
        its deepest would hardly be felt at any other depth. Its damping, whose own slope grows with
        speed, is scaled to the rest that the spring leaves.
        """
        deepest = _deepest(wall, self._force_max) if wall.k > 0 else math.inf
        own, of_damping, damping = _parts_of_model(wall, self._force_max, self._velocity_max)
        spring = self._bound.softened(own)
        calming = self._calming(own, spring, 0.0)
        calm = self._calm(spring, calming, of_damping, damping)
        soft = spring + calm * of_damping
        self._judge(own + of_damping, damping, soft, calm * damping + calming)
        if not self.rendered_bound.reduced:
            return wall
        bent = replace(wall, stiffest=spring, damped_depth=deepest)
        return replace(bent, b=calm * wall.b, calming=calming)

    def _calm(self, spring: float, calming: float, of_damping: float, damping: float) -> float:
        """Return the share of a damping that a spring leaves, with the slope that comes with it.

        The passive range is convex in K and B, so the line from the stiffest spring to the most
        damping beside this one is passive, too.
        """
        most_k, most_b = spring + of_damping, calming + damping
        if self._bound.required_damping(most_k, most_b) <= self._bound.available:
            return 1.0
        room, most = self.stiffness_max - spring, self._bound.damping_max(spring)
        if room <= 0.0 or most <= calming:
            return 0.0
        return min(1.0, (most - calming) / (damping + most * of_damping / room))

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
        soft, calm = min(soft, stiffness), min(calm, damping)
        calming = self._calming(self.rendered_bound.true_stiffness, soft, calm)
        self.rendered_bound = replace(
            self.rendered_bound,
            rendered_stiffness=soft,
            rendered_damping=calm + calming,
        )
        return replace(wall, calming=calming)


def _shared_out(allowed: float, own: float, total: float) -> tuple[float, float]:
    """Return the factors of a model's own slope and of its effects' that make the allowed total."""
    if allowed >= total:
        return 1.0, 1.0
    if allowed >= own:
        return 1.0, (allowed - own) / (total - own)
    return allowed / own, 0.0


def _eased(
    term: RenderedEffect, depth: float, of_springs: float, of_dampers: float
) -> RenderedEffect:
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
