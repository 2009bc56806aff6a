"""Effects of the tool and its guide: they act in free air as well."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sin

from teleop_rt.contact.effect import OF_THE_SPRING, Amplitude, Effect, Shape, Vector
from teleop_rt.contact.effects.stiffening import SPRING_POWER
from teleop_rt.contact.law import spring_force
from teleop_rt.kernels.jit import kernel


@kernel
def _speed(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return v


@kernel
def _forward_speed(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return max(v, 0.0)


@kernel
def _forward_speed_with_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return spring_force(max(x, 0.0), 1.0, eta[0]) * max(v, 0.0)


@kernel
def _two_speeds(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return v if v > 0.0 else float(eta[0] * v)


@kernel
def _lever(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return sin(x + eta[0])


@kernel
def _linkage(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return sin(x / eta[0] + eta[1])


@kernel
def _acceleration(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return a


THROUGH_A_LINKAGE = "through a linkage"  # law of a lever's weight on a linear axis
# Over less than half a turn its force may be that of a spring that stiffens.
LINKAGE_BESIDE_A_SPRING = f"{THROUGH_A_LINKAGE}, beside a spring"
# A linkage turns by at least half a radian, or its weight is a bias, and by less than one turn.
_ARM = Shape("arm", "{x}", 0.16, 2.0, 0.5, reciprocal=True, relative_to="travel", points=8)
_LEVER_ANGLE = Shape("lever_angle", "rad", -2 * pi, 2 * pi, 0.0, phase=True)

_LINKAGE = Effect(
    name="gravity_torque",
    law=THROUGH_A_LINKAGE,
    family="bias",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("torque", "{f}", nonnegative=True),
    shapes=(_ARM, _LEVER_ANGLE),
    step=_linkage,
    sentence="Gravity turns a linkage of arm {arm}, felt as up to {torque} along the axis.",
    compensation="subtract_force",
    only_in_contact=False,
    like=("force_bias", "second_layer"),  # constant in air, a bend in contact
)
EFFECTS = (
    Effect(
        name="viscous_friction",
        family="damping",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("viscous_friction", "{f} s/{x}", nonnegative=True),
        step=_speed,
        sentence="Viscous friction of {viscous_friction} in the guide.",
        compensation="subtract_force",
        derivative_order=1,
        only_in_contact=False,
    ),
    Effect(
        name="direction_dependent_damping",
        law="everywhere",
        family="friction",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("extra_forward_damping", "{f} s/{x}"),
        step=_forward_speed,
        sentence="Damping is {extra_forward_damping} larger when moving forward.",
        turned="Damping is {-extra_forward_damping} smaller when moving forward.",
        compensation="subtract_force",
        derivative_order=1,
        only_in_contact=False,
    ),
    Effect(
        name="direction_dependent_damping",
        law="in contact",
        family="friction",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("extra_forward_damping", "{f} s/{x}"),
        step=_forward_speed,
        sentence="Damping is {extra_forward_damping} larger when moving forward.",
        turned="Damping is {-extra_forward_damping} smaller when moving forward.",
        compensation="subtract_force",
        derivative_order=1,
    ),
    Effect(
        name="direction_dependent_damping",
        law=f"growing with depth {OF_THE_SPRING}",
        family="friction",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("extra_forward_damping", "{f} s/{x}^(power+1)"),
        shapes=(SPRING_POWER,),
        step=_forward_speed_with_spring,
        sentence="Damping, which grows with the force, is {extra_forward_damping} larger forward.",
        compensation="subtract_force",
        derivative_order=1,
    ),
    Effect(
        name="direction_dependent_damping",
        law="by a ratio",
        family="friction",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("forward_damping", "{f} s/{x}", nonnegative=True),
        shapes=(Shape("ratio", "1", 0.0, 4.0, 0.5, points=6, neutral=1.0),),
        step=_two_speeds,
        sentence="Guide damping is {forward_damping} forward, {ratio} times that backward.",
        compensation="subtract_force",
        derivative_order=1,
        only_in_contact=False,
    ),
    Effect(
        name="direction_dependent_damping",
        law="by a ratio, in contact",
        family="friction",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("forward_damping", "{f} s/{x}", nonnegative=True),
        shapes=(Shape("ratio", "1", 0.0, 4.0, 0.5, points=4, neutral=1.0),),
        step=_two_speeds,
        sentence="Contact adds {forward_damping} forward, {ratio} times that backward.",
        compensation="subtract_force",
        derivative_order=1,
    ),
    Effect(
        name="gravity_torque",
        family="bias",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("torque", "{f}", nonnegative=True),
        shapes=(_LEVER_ANGLE,),
        step=_lever,
        sentence="Gravity turns the lever with up to {torque}.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    _LINKAGE,
    replace(
        _LINKAGE,
        law=LINKAGE_BESIDE_A_SPRING,
        shapes=(replace(_ARM, upper=1.0 / pi), _LEVER_ANGLE),
        like=(),
    ),
    Effect(
        name="tool_inertia",
        family="inertia",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("mass", "{f} s^2/{x}", nonnegative=True),
        step=_acceleration,
        sentence="{mass} move between the environment and the sensor.",
        compensation="subtract_force",
        derivative_order=2,
        only_in_contact=False,
    ),
)
