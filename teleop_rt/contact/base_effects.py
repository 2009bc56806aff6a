"""The terms that the report's contact models are made of, as effects with unit amplitude."""

# ruff: noqa: ARG001 - every step function has the signature of the declaration

from __future__ import annotations

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.contact.law import damped_velocity, damping_at, spring_force, touches
from teleop_rt.kernels.jit import kernel


@kernel
def _inertia(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return a


@kernel
def _stiffness(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return max(0.0, x)


@kernel
def _damping(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return v if touches(x) else 0.0


@kernel
def _unilateral_damping(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return damped_velocity(v, one_way=True) if touches(x) else 0.0


@kernel
def _viscous(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return v


@kernel
def _power_stiffness(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return spring_force(x, 1.0, eta[0]) if touches(x) else 0.0


@kernel
def _power_damping(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return damping_at(x, 1.0, eta[0]) * v if touches(x) else 0.0


_EXPONENT = Shape("n", "1", lower=0.5, upper=4.0, start=1.5)

INERTIA = Effect(
    name="inertia",
    family="inertia",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("m", "{f} s^2/{x}", nonnegative=True),
    step=_inertia,
    sentence="a mass of {m}",
    compensation="render",
    derivative_order=2,
)
FREE_INERTIA = Effect(
    name="free_inertia",
    family="inertia",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("m", "{f} s^2/{x}", nonnegative=True),
    step=_inertia,
    sentence="a moving mass of {m}, in contact or not",
    compensation="subtract_force",
    derivative_order=2,
    only_in_contact=False,
)
STIFFNESS = Effect(
    name="stiffness",
    family="elastic",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("k", "{f}/{x}", nonnegative=True),
    step=_stiffness,
    sentence="a linear spring of {k}",
    compensation="render",
)
DAMPING = Effect(
    name="damping",
    family="damping",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("b", "{f} s/{x}", nonnegative=True),
    step=_damping,
    sentence="viscous damping of {b}",
    compensation="render",
    derivative_order=1,
)
UNILATERAL_DAMPING = Effect(
    name="unilateral_damping",
    family="damping",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("b", "{f} s/{x}", nonnegative=True),
    step=_unilateral_damping,
    sentence="viscous damping of {b} while pressing in",
    compensation="render",
    derivative_order=1,
)
FREE_DAMPING = Effect(
    name="free_damping",
    family="damping",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("b", "{f} s/{x}", nonnegative=True),
    step=_viscous,
    sentence="viscous damping of {b}, in contact or not",
    compensation="subtract_force",
    derivative_order=1,
    only_in_contact=False,
)
POWER_STIFFNESS = Effect(
    name="power_stiffness",
    family="elastic",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("k", "{f}/{x}^n", nonnegative=True),
    step=_power_stiffness,
    sentence="a spring k x^n of {k} with the exponent {n}",
    compensation="render",
    shapes=(_EXPONENT,),
)
POWER_DAMPING = Effect(
    name="power_damping",
    family="damping",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("b", "{f} s/{x}^(n+1)", nonnegative=True),
    step=_power_damping,
    sentence="damping b x^n of {b} with the exponent {n}",
    compensation="render",
    shapes=(_EXPONENT,),
    derivative_order=1,
)
