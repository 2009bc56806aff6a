"""A rendered wall: the streamed model as a force law over the slave's axis position."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from teleop_rt.contact.law import touches
from teleop_rt.link.messages import ModelMessage
from teleop_rt.master.rendered_effects import RenderedEffect
from teleop_rt.master.wall_law import DepthLaw, damped, elastic, knee_of, stored, stretch_of

_HALVINGS = 40
"""Of the search for a depth: 1e-12 of its range."""
MOTION_REMEMBERED_S = 1.0
"""Time constant in which a surface comes to rest of which nothing more is heard: breath turns."""


@dataclass(frozen=True, slots=True)
class Wall:
    """Force k xⁿ + b xᵖ ẋ for penetration x = position - surface > 0, never negative.

    Kelvin-Voigt has n = 1, p = 0 (2.1); Hunt-Crossley p = n (2.4); with `approach_only` the
    damping acts for ẋ > 0 alone (2.2). A `bilateral` wall has no known surface: it acts on both
    sides of `surface` with the force `offset` there, and may pull. Where the power law grows
    steeper than `stiffest` it goes on as a straight line of that slope, and its damping grows no
    more from `damped_depth` on: a device that cannot render it at depth does so above. `terms` are
    effects beside it: they add force, as an adhesion does even outside, or move the surface. Their
    force is that at the hand, where their memories are; elsewhere it follows from the depth alone.
    The surface moves by itself at `surface_velocity`. `calming` is damping at every depth that is
    no part of the body: it makes up for the latency of a spring that is rendered softer. `law` is
    its force law by depth, for kernels.
    """

    surface: float
    k: float = 0.0
    b: float = 0.0
    n: float = 1.0
    damping_power: float = 0.0
    approach_only: bool = False
    bilateral: bool = False
    offset: float = 0.0
    stiffest: float = math.inf
    damped_depth: float = math.inf
    terms: tuple[RenderedEffect, ...] = ()
    surface_velocity: float = 0.0
    calming: float = 0.0
    law: DepthLaw = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        law = DepthLaw(
            self.k, self.b, self.n, self.damping_power, self.approach_only, self.bilateral,
            self.offset, self.stiffest, self.damped_depth, self.surface_velocity, self.calming,
            knee_of(self.k, self.n, self.stiffest),
        )  # fmt: skip
        object.__setattr__(self, "law", law)  # once: a wall does not change

    def moved(self, time_s: float, share: float = 1.0) -> Wall:
        """Return the wall a time later, its surface moving at a share of its velocity.

        Without news of it, a surface comes to rest.
        """
        if self.surface_velocity == 0.0:
            return self
        return replace(
            self,
            surface=self.surface + share * self.surface_velocity * time_s,
            surface_velocity=self.surface_velocity * math.exp(-time_s / MOTION_REMEMBERED_S),
        )

    @property
    def surface_now(self) -> float:
        """Where the surface is now: effects may have moved it."""
        if not self.terms:
            return self.surface
        moved: float = sum(t.amplitude * t.memory.value for t in self.terms if t.memory.moves)
        return self.surface - moved

    @property
    def pull(self) -> float:
        """The force of effects that act outside contact, too; at most 0 where it pulls."""
        if not self.terms:
            return 0.0
        return sum(
            t.amplitude * t.memory.value
            for t in self.terms
            if not t.memory.moves and not t.memory.in_contact
        )

    def holds(self, position: float) -> bool:
        """Return whether the wall acts at this position."""
        if not self.terms:
            return self.bilateral or touches(position - self.surface)
        return self.bilateral or touches(position - self.surface_now) or self.pull != 0.0

    def elastic_force(self, position: float) -> float:
        """Return the force of the spring alone, and of the springs within the effects."""
        x = position - self.surface_now
        force = elastic(self.law, x)
        if touches(x):
            for t in self.terms:
                if not t.memory.moves and t.memory.in_contact:
                    force += t.amplitude * t.memory.value_at(x)
        return force

    def position_of(self, elastic_force: float) -> float:
        """Return the position where the spring gives this force; the surface where it has none."""
        if self.k <= 0 or elastic_force <= 0:
            return self.surface_now
        depth = stretch_of(self.law, elastic_force)
        if not self.terms:
            return self.surface + depth
        low, high = self.surface_now, self.surface_now + 2 * depth
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            if self.elastic_force(middle) < elastic_force:
                low = middle
            else:
                high = middle
        return high

    def force(self, position: float, velocity: float) -> float:
        """Return the force at a position and velocity: those of the hand, if there are terms."""
        if not self.holds(position):
            return 0.0
        x = position - self.surface_now
        if not (touches(x) or self.bilateral):
            return self.pull
        force = damped(self.law, x, velocity)
        if not self.terms:
            return force if self.bilateral else max(0.0, force)
        force += sum(t.force for t in self.terms if not t.memory.moves and t.memory.in_contact)
        return max(0.0, force) + self.pull

    def energy(self, position: float, force_max: float = math.inf) -> float:
        """Return the energy stored in the spring [J], 0 where it is relaxed.

        Beyond `force_max` the spring pushes no harder, and stores that much less. Effects beside
        it add the energy of their own springs.
        """
        x = position - self.surface_now
        own = stored(self.law, x, force_max)
        return own + sum(t.amplitude * t.memory.energy(x) for t in self.terms)


NO_WALL = Wall(surface=math.inf)


def wall_of(model: ModelMessage, terms: tuple[RenderedEffect, ...] = ()) -> Wall | None:
    """Return the wall of a streamed model with the effects beside it; None where it has nothing.

    Mass is never rendered: it would take an acceleration that the device does not measure.
    """
    if model.model == "mass":
        return None
    is_hunt_crossley = model.model == "hunt-crossley"
    return Wall(
        surface=model.surface,
        k=model.k,
        b=model.b,
        n=model.n if is_hunt_crossley else 1.0,
        damping_power=model.n if is_hunt_crossley else 0.0,
        approach_only=model.model == "kelvin-voigt-unilateral",
        bilateral=not model.surface_known,
        offset=model.offset,
        terms=() if not model.surface_known else terms,
        surface_velocity=model.surface_velocity if model.surface_known else 0.0,
    )
