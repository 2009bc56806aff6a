"""The contact law (2.1, 2.2, 2.4), declared once: f = k xⁿ + b xᵖ ẋ at a depth x > 0.

Kelvin-Voigt has n = 1, p = 0; Hunt-Crossley p = n, and never pulls; damping may act one way only.
Each function is plain Python where Python calls it, and compiled into the kernels that call it.
"""

from __future__ import annotations

import math
from typing import overload

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import shared

MOST_LOG_FORCE = 50.0
"""Largest |ln f| of a force [rig unit]: e⁵⁰ is beyond any force, and its square still a number."""
EXPONENT_LEAST, EXPONENT_MOST = 0.3, 20.0
"""Exponents n of an estimate that may be of a wall; one beyond them is no estimate."""


@overload
def touches(depth: float) -> bool: ...
@overload
def touches(depth: Vector) -> NDArray[np.bool_]: ...
@shared
def touches(depth: float | Vector) -> bool | NDArray[np.bool_]:
    """Return whether a tool at this depth is in contact; it is in free air otherwise.

    Where the surface is not known, the force decides: contact/detection.py.
    """
    return depth > 0.0


@overload
def spring_force(depth: float, stiffness: float, exponent: float) -> float: ...
@overload
def spring_force(depth: Vector, stiffness: float, exponent: float) -> Vector: ...
@shared
def spring_force(depth: float | Vector, stiffness: float, exponent: float) -> float | Vector:
    """Return k xⁿ at a depth >= 0."""
    force: float | Vector = stiffness * depth**exponent
    return force


@shared
def spring_force_of_log(depth: float, log_stiffness: float, exponent: float) -> float:
    """Return k xⁿ of ln k at a depth > 0, as estimators hold k: no k or n overflows."""
    log_force = log_stiffness + exponent * math.log(depth)
    return math.exp(min(max(log_force, -MOST_LOG_FORCE), MOST_LOG_FORCE))


@shared
def spring_energy(depth: float, stiffness: float, exponent: float) -> float:
    """Return k xⁿ⁺¹ / (n + 1), the energy stored at a depth >= 0."""
    energy: float = stiffness * depth ** (exponent + 1.0) / (exponent + 1.0)
    return energy


@shared
def spring_depth(force: float, stiffness: float, exponent: float) -> float:
    """Return the depth at which k xⁿ is a force >= 0."""
    depth: float = (force / stiffness) ** (1.0 / exponent)
    return depth


@shared
def spring_slope(depth: float, stiffness: float, exponent: float) -> float:
    """Return n k xⁿ⁻¹, the slope of the spring's force at a depth >= 0 (> 0 for n < 1)."""
    slope: float = exponent * stiffness * depth ** (exponent - 1.0)
    return slope


@shared
def joint_deflection(force: float, compliance: float, stiffening_force: float) -> float:
    """Return c f / (1 + |f|/f₀), the deflection of a joint that is twice as stiff at f₀ (or inf).

    A joint that seats under load, as a nut, a taper or a flange; inf is a linear spring.
    """
    deflection: float = compliance * force / (1.0 + abs(force) / stiffening_force)
    return deflection


@shared
def force_behind_joint(rigid: float, stiffness_ratio: float, stiffening_force: float) -> float:
    """Return the force f of a spring behind a joint, of which a rigid one would press `rigid`.

    f = rigid - k c f / (1 + |f|/f₀), a quadratic equation; `stiffness_ratio` is k c [1].
    """
    a = abs(rigid) / stiffening_force
    half = 0.5 * (1.0 + stiffness_ratio - a)
    root = math.sqrt(half * half + a)
    size = abs(rigid) / (root + half) if half > 0.0 else stiffening_force * (root - half)
    return math.copysign(size, rigid)


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
