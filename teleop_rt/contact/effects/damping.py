"""Damping of a material that no straight line over the velocity describes."""

from __future__ import annotations

from dataclasses import replace

from teleop_rt.contact.effect import (
    OF_THE_SPRING,
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    Vector,
)
from teleop_rt.contact.effects.stiffening import SPRING_POWER
from teleop_rt.contact.law import spring_force
from teleop_rt.kernels.jit import kernel


@kernel
def _quadratic(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return v * abs(v)


@kernel
def _quadratic_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return max(x, 0.0) * v * abs(v)


@kernel
def _quadratic_with_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return spring_force(max(x, 0.0), 1.0, eta[0]) * v * abs(v)


@kernel
def _quadratic_along(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x - eta[0], 0.0) * v * abs(v))


@kernel
def _damped_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x, 0.0) ** eta[0] * v)


@kernel
def _damped_along(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x - eta[0], 0.0) * v)


_DAMPING_POWER = Shape("power", "1", 0.3, 3.0, 1.0, points=5)  # 0 is the base's own damping
# From beyond the stroke the damping hardly changes along it.
_ORIGIN = Shape("origin", "{x}", -2.0, 2.0, 0.0, relative_to="place", points=5)
_PER_LENGTH = Amplitude("quadratic_damping", "{f} s^2/{x}^3", nonnegative=True)
_QUADRATIC = Effect(
    name="quadratic_damping",
    law="plain",
    family="damping",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("quadratic_damping", "{f} s^2/{x}^2", nonnegative=True),
    step=_quadratic,
    sentence="Damping grows with the square of the speed: {quadratic_damping}.",
    compensation="render",
    derivative_order=1,
)
_HELD_QUADRATIC = replace(_QUADRATIC, law=WITHOUT_CONTACT, only_in_contact=False)
EFFECTS = (
    Effect(
        name="hunt_crossley",  # Hunt and Crossley 1975, the damping (2.4) beside any spring
        family="damping",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("damping", "{f} s/{x}^(power+1)", nonnegative=True),
        shapes=(_DAMPING_POWER,),
        step=_damped_with_depth,
        sentence="Damping grows with the depth, with the power {power} (Hunt and Crossley).",
        compensation="render",
        derivative_order=1,
    ),
    Effect(
        name="hunt_crossley",
        law=WITHOUT_CONTACT,
        family="damping",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("damping", "{f} s/{x}^2", nonnegative=True),
        shapes=(_ORIGIN,),
        step=_damped_along,
        sentence="Damping grows along the stroke from {origin} on.",
        compensation="render",
        only_in_contact=False,
        derivative_order=1,
    ),
    _QUADRATIC,
    replace(
        _QUADRATIC,
        law="growing with depth",
        amplitude=_PER_LENGTH,
        step=_quadratic_with_depth,
        sentence="Damping grows with depth and the square of the speed: {quadratic_damping}.",
    ),
    replace(
        _QUADRATIC,
        law=f"growing with depth {OF_THE_SPRING}",
        amplitude=Amplitude("quadratic_damping", "{f} s^2/{x}^(power+2)", nonnegative=True),
        shapes=(SPRING_POWER,),
        step=_quadratic_with_spring,
        sentence="Damping grows with the force and the square of the speed: {quadratic_damping}.",
    ),
    _HELD_QUADRATIC,
    replace(
        _HELD_QUADRATIC,
        law=f"{WITHOUT_CONTACT}, growing along the stroke",
        amplitude=_PER_LENGTH,
        shapes=(_ORIGIN,),
        step=_quadratic_along,
        sentence="Damping grows from {origin} on, and with the square of the speed.",
        extends=WITHOUT_CONTACT,
    ),
    # A cylinder's oil, or a tool under water.
    replace(
        _HELD_QUADRATIC,
        law="in air and contact",
        belongs_to="rig",
        stage="tool",
        sentence="Drag of {quadratic_damping} times the square of the speed, in free air, too.",
        compensation="subtract_force",
    ),
)
