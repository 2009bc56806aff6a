"""The answer of a rendered wall at a depth, without the effects beside it: force, spring, energy.

Each function is plain Python where Python calls it, and part of `felt`, which a tick calls.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from teleop_rt.contact.law import damping_at, spring_depth, spring_energy, spring_force, touches
from teleop_rt.kernels.jit import kernel, shared

_LARGEST_LOGARITHM = 700.0
"""Of a float, which has no larger power of e."""


class DepthLaw(NamedTuple):
    """The numbers of a `Wall` that its force at a depth is made of, and its `knee`."""

    k: float
    b: float
    n: float
    damping_power: float
    approach_only: bool
    bilateral: bool
    offset: float
    stiffest: float
    damped_depth: float
    surface_velocity: float
    calming: float
    knee: float


def knee_of(k: float, n: float, stiffest: float) -> float:
    """Return the depth from which the spring is a straight line; infinite where it never is."""
    if k <= 0.0 or math.isinf(stiffest):
        return math.inf
    if n == 1.0:
        return 0.0 if k > stiffest else math.inf
    if stiffest <= 0.0:
        return 0.0
    logarithm = (math.log(stiffest) - math.log(n * k)) / (n - 1)
    return math.exp(logarithm) if logarithm < _LARGEST_LOGARITHM else math.inf


@shared
def spring(law: DepthLaw, x: float) -> float:
    """Return the force of the spring at a depth x >= 0."""
    bent = min(x, law.knee)
    force = spring_force(bent, law.k, law.n)
    if x > bent:
        force += law.stiffest * (x - bent)
    return force


@shared
def elastic(law: DepthLaw, x: float) -> float:
    """Return the force of the spring, 0 outside, or that of a bilateral wall."""
    if law.bilateral:
        return law.offset + law.k * x
    return spring(law, x) if touches(x) else 0.0


@shared
def stretch_of(law: DepthLaw, force: float) -> float:
    """Return the depth at which the spring gives a force > 0."""
    at_knee = math.inf if math.isinf(law.knee) else spring_force(law.knee, law.k, law.n)
    if force > at_knee:
        return law.knee + (force - at_knee) / law.stiffest
    return spring_depth(force, law.k, law.n)


@shared
def damped(law: DepthLaw, x: float, velocity: float) -> float:
    """Return the force of spring and damper at a depth x where the wall acts."""
    b = 0.0 if law.approach_only and velocity < 0.0 else law.b
    b = damping_at(min(x, law.damped_depth), b, law.damping_power)
    return elastic(law, x) + (b + law.calming) * (velocity - law.surface_velocity)


@shared
def energy_at(law: DepthLaw, x: float) -> float:
    """Return the energy of the spring at a depth x >= 0."""
    bent = min(x, law.knee)
    energy = spring_energy(bent, law.k, law.n)
    straight = x - bent
    if straight <= 0.0:
        return energy
    at_knee = spring_force(bent, law.k, law.n)
    energy += straight * (at_knee + 0.5 * law.stiffest * straight)
    return energy


@shared
def stored(law: DepthLaw, x: float, force_max: float) -> float:
    """Return the energy of the spring [J]; one that would push beyond `force_max` stores less."""
    force = abs(elastic(law, x))
    if law.k <= 0.0 or force == 0.0:
        return 0.0
    stretch = stretch_of(law, min(force, force_max))
    energy = energy_at(law, stretch)
    if force <= force_max:
        return energy
    return energy + force_max * (stretch_of(law, force) - stretch)


@shared
def within(force: float, force_max: float) -> float:
    """Return a force, at most `force_max` either way."""
    return max(-force_max, min(force_max, force))


@kernel
def felt(
    k: float,
    b: float,
    n: float,
    damping_power: float,
    approach_only: bool,
    bilateral: bool,
    offset: float,
    stiffest: float,
    damped_depth: float,
    surface_velocity: float,
    calming: float,
    knee: float,
    x: float,
    velocity: float,
    force_max: float,
) -> tuple[float, float, float]:
    """Return force, spring's force and energy of a law, field by field, at a depth x."""
    law = DepthLaw(
        k, b, n, damping_power, approach_only, bilateral, offset, stiffest,
        damped_depth, surface_velocity, calming, knee,
    )  # fmt: skip
    force = 0.0
    if law.bilateral:
        force = damped(law, x, velocity)
    elif touches(x):
        force = max(0.0, damped(law, x, velocity))
    spring_N = within(elastic(law, x), force_max)
    return within(force, force_max), spring_N, stored(law, x, force_max)
