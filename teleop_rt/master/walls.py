"""A rendered wall: the streamed model as a force law over the slave's axis position."""

from __future__ import annotations

import math
from dataclasses import dataclass

from teleop_rt.link.messages import Model


@dataclass(frozen=True, slots=True)
class Wall:
    """Force k xⁿ + b xᵖ ẋ for penetration x = position - surface > 0, never negative.

    Kelvin-Voigt has n = 1, p = 0 (2.1); Hunt-Crossley p = n (2.4); with `approach_only` the
    damping acts for ẋ > 0 alone (2.2). A `bilateral` wall has no known surface: it acts on both
    sides of `surface` with the force `offset` there, and may pull.
    """

    surface: float
    k: float = 0.0
    b: float = 0.0
    n: float = 1.0
    damping_power: float = 0.0
    approach_only: bool = False
    bilateral: bool = False
    offset: float = 0.0

    def holds(self, position: float) -> bool:
        """Tell whether the wall acts at this position."""
        return self.bilateral or position > self.surface

    def elastic_force(self, position: float) -> float:
        """Return the force of the spring alone."""
        x = position - self.surface
        if self.bilateral:
            return self.offset + self.k * x
        return self.k * x**self.n if x > 0 else 0.0

    def position_of(self, elastic_force: float) -> float:
        """Return the position where the spring gives this force; the surface where it has none."""
        if self.k <= 0 or elastic_force <= 0:
            return self.surface
        depth: float = (elastic_force / self.k) ** (1 / self.n)
        return self.surface + depth

    def force(self, position: float, velocity: float) -> float:
        """Return the force at a position and velocity."""
        if not self.holds(position):
            return 0.0
        if self.approach_only and velocity < 0:
            return self.elastic_force(position)
        b = self.b
        if self.damping_power:
            b *= (position - self.surface) ** self.damping_power
        force = self.elastic_force(position) + b * velocity
        return force if self.bilateral else max(0.0, force)

    def energy(self, position: float, force_max: float = math.inf) -> float:
        """Return the energy stored in the spring [J], 0 where it is relaxed.

        Beyond `force_max` the spring pushes no harder, and stores that much less.
        """
        force = abs(self.elastic_force(position))
        if self.k <= 0 or force == 0:
            return 0.0
        stretch: float = (min(force, force_max) / self.k) ** (1 / self.n)
        stored: float = self.k * stretch ** (self.n + 1) / (self.n + 1)
        if force <= force_max:
            return stored
        beyond: float = (force / self.k) ** (1 / self.n) - stretch
        return stored + force_max * beyond


NO_WALL = Wall(surface=math.inf)


def wall_of(model: Model) -> Wall | None:
    """Return the wall of a streamed model, or None where it has nothing to render.

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
    )
