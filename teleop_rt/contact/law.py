"""The contact law (2.1, 2.2, 2.4), declared once: f = k xⁿ + b xᵖ ẋ at a depth x > 0.

Kelvin-Voigt has n = 1, p = 0; Hunt-Crossley p = n, and never pulls; damping may act one way only.
Each function is plain Python where Python calls it, and compiled into the kernels that call it.
"""

from __future__ import annotations

from teleop_rt.jit import shared


@shared
def touches(depth: float) -> bool:
    """Return whether a tool at this depth is in contact; it is in free air otherwise."""
    return depth > 0.0


@shared
def spring_force(depth: float, stiffness: float, exponent: float) -> float:
    """Return k xⁿ at a depth >= 0."""
    force: float = stiffness * depth**exponent
    return force


@shared
def damping_at(depth: float, damping: float, exponent: float) -> float:
    """Return b xᵖ, the damping at a depth >= 0."""
    at_depth: float = damping * depth**exponent
    return at_depth


@shared
def damped_velocity(velocity: float, one_way: bool) -> float:
    """Return the velocity that is damped: with `one_way`, none while the tool comes out."""
    return max(velocity, 0.0) if one_way else velocity


@shared
def linear_force(depth: float, velocity: float, stiffness: float, damping: float) -> float:
    """Return k x + b ẋ (2.1), the law for n = 1, p = 0."""
    return stiffness * depth + damping * velocity


@shared
def power_force(
    depth: float, velocity: float, stiffness: float, damping: float, exponent: float
) -> float:
    """Return xⁿ (k + b ẋ) (2.4), the law for p = n, at a depth > 0; it never pulls."""
    return max(0.0, spring_force(depth, 1.0, exponent) * (stiffness + damping * velocity))
