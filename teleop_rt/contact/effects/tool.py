"""Effects of the tool and its guide: they act in free air as well."""

from __future__ import annotations

from dataclasses import replace
from math import pi, sin

from teleop_rt.contact.effect import OF_THE_SPRING, Amplitude, Effect, Shape, Vector
from teleop_rt.contact.effects.stiffening import SPRING_POWER
from teleop_rt.contact.law import spring_force
from teleop_rt.kernels.jit import kernel

_COLUMN = 0.1  # rig unit; length of a gas column at which its stiffness is stated


@kernel
def _speed(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return v


@kernel
def _place(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return x


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
def _beside_rest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(x - eta[0])


@kernel
def _taut_beyond(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x - eta[0], 0.0))


@kernel
def _taut_before(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(min(x - eta[0], 0.0))


@kernel
def _gas_ahead(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Push back with gas of a column that ends at eta[0]; it is compressed forwards."""
    length = max((eta[0] - x) / _COLUMN, 1e-9)
    return float(_COLUMN / eta[1] * length ** -eta[1])


@kernel
def _gas_behind(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Push on with gas of a column that ends at eta[0]; it is compressed backwards."""
    length = max((x - eta[0]) / _COLUMN, 1e-9)
    return float(-_COLUMN / eta[1] * length ** -eta[1])


@kernel
def _acceleration(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return a


BESIDE_A_BODY = "about its rest"  # law of the same where a body is touched
RETURN_SPRING = "return_spring"  # effect of a drive alone
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
_ABOUT_ITS_REST = Effect(
    name=RETURN_SPRING,
    law=BESIDE_A_BODY,
    family="elastic",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(Shape("rest", "{x}", -3.0, 3.0, 0.0, relative_to="place", points=8),),
    step=_beside_rest,
    sentence="A spring, cable or hose pulls the axis to {rest} with {spring_stiffness}.",
    compensation="subtract_force",
    only_in_contact=False,
    like=("force_bias",),
)
# The column of a gas ends beyond the stroke, and is hardly longer than a few of them.
_COLUMN_END = Shape("column_end", "{x}", 0.55, 5.0, 1.5, relative_to="place",
                    points=6)  # fmt: skip
# From slow to quick compression: isothermal, adiabatic of a diatomic gas, of a noble gas.
_EXPONENT = Shape("exponent", "1", 1.0, 1.67, 1.25, points=1)
_GAS_SPRING = Effect(
    name=RETURN_SPRING,
    law="of gas, compressed forwards",
    family="elastic",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(_COLUMN_END, _EXPONENT),
    step=_gas_ahead,
    sentence=(
        "A gas spring, of {spring_stiffness} where its column is 0.1 long, pushes with a column"
        " that ends at {column_end}."
    ),
    compensation="subtract_force",
    only_in_contact=False,
)
# A cable that is taut from a place inside the body on is the force of a second layer.
_REST_IN_AIR = Shape("rest", "{x}", -5.0, 0.0, -1.0, relative_to="travel", points=8)

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
        name=RETURN_SPRING,
        family="elastic",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("spring_stiffness", "{f}/{x}", nonnegative=True),
        step=_place,
        sentence="A spring, cable or hose pulls the axis back with {spring_stiffness}.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    _ABOUT_ITS_REST,
    *(
        replace(
            _ABOUT_ITS_REST,
            law=f"{BESIDE_A_BODY}, slack {side} it",
            shapes=(shape,),
            step=step,
            sentence=f"A cable, slack {side} {{rest}}, pulls the axis with {{spring_stiffness}}.",
            like=(),
        )
        for side, step, shape in (
            ("before", _taut_beyond, _REST_IN_AIR),
            ("beyond", _taut_before, _ABOUT_ITS_REST.shapes[0]),
        )
    ),
    _GAS_SPRING,
    replace(
        _GAS_SPRING,
        law="of gas, compressed backwards",
        shapes=(replace(_COLUMN_END, lower=-5.0, upper=-0.55, start=-1.5), _EXPONENT),
        step=_gas_behind,
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
