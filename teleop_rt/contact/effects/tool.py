"""Effects of the tool and its guide: they act in free air as well."""

from __future__ import annotations

from dataclasses import replace
from math import cos, exp, pi, sin, tanh

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.jit import kernel


@kernel
def _smoothed_sign(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return tanh(v / eta[0])


@kernel
def _smoothed_sign_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(tanh(v / eta[0]) * max(x, 0.0))


@kernel
def _presliding(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance Dahl's z' = v/d (1 - z sgn v): elastic before it slides; exact over a sample."""
    sign = 1.0 if v > 0.0 else -1.0
    state[0] = sign + (state[0] - sign) * exp(-abs(v) * dt / eta[0])
    return float(state[0])


@kernel
def _sign_by_direction(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    slid = tanh(v / eta[0])
    return slid if v > 0.0 else float(eta[1] * slid)


@kernel
def _presliding_by_direction(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    goal = 1.0 if v > 0.0 else -eta[1]
    state[0] = goal + (state[0] - goal) * exp(-abs(v) * dt / eta[0])
    return float(state[0])


@kernel
def _stribeck_smoothed(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(tanh(v / eta[2]) * (1.0 + eta[1] * exp(-((v / eta[0]) ** 2))))


@kernel
def _stribeck_presliding(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    sign = 1.0 if v > 0.0 else -1.0
    level = 1.0 + eta[1] * exp(-((v / eta[0]) ** 2))
    goal = sign * level
    state[0] = goal + (state[0] - goal) * exp(-abs(v) * dt / (eta[2] * level))
    return float(state[0])


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


@kernel
def _ripple(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return sin(2.0 * pi * x / eta[0] + eta[1])


RETURN_SPRING = "return_spring"  # effect of a drive alone


@kernel
def _two_harmonics(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return sin(u + p) + s sin(2u + p) + c cos(2u + p), u = 2 pi x / pitch: of any phase p two."""
    first = 2.0 * pi * x / eta[0] + eta[1]
    second = 2.0 * first - eta[1]
    return float(sin(first) + eta[2] * sin(second) + eta[3] * cos(second))


THROUGH_A_LINKAGE = "through a linkage"  # law of a lever's weight on a linear axis
# What does not come back within the travel is no ripple.
_PITCH = Shape(
    "pitch", "{x}", 1.0 / 60.0, 0.5, 0.2, reciprocal=True, relative_to="travel", points=118
)
# A linkage turns by at least half a radian, or its weight is a bias, and by less than one turn.
_ARM = Shape("arm", "{x}", 0.16, 2.0, 0.5, reciprocal=True, relative_to="travel", points=8)
_LEVER_ANGLE = Shape("lever_angle", "rad", -2 * pi, 2 * pi, 0.0, phase=True)
_PHASE = Shape("phase", "rad", -2 * pi, 2 * pi, 0.0, phase=True)
_SECOND_HARMONIC = tuple(
    Shape(name, "1", -1.0, 1.0, 0.0, points=1) for name in ("second_sine", "second_cosine")
)
_SMOOTHING = Shape(
    "smoothing_velocity",
    "{x}/s",
    5e-4,
    0.2,
    0.01,
    logarithmic=True,
    relative_to="speed",
    points=6,
    ideal="lower",
)
# Seals and fretting joints give by up to half of a small stroke before they slide.
_PRESLIDING = Shape(
    "presliding_travel",
    "{x}",
    5e-5,
    0.6,
    2e-3,
    logarithmic=True,
    relative_to="travel",
    points=7,
    ideal="lower",
)
# Friction that gives way over more is not seen to fall with speed.
_SHORT_PRESLIDING = replace(_PRESLIDING, upper=0.03, points=5)
# Beyond twice as much in one direction it would be a bias with some friction, not friction.
_BACKWARD = Shape("backward_ratio", "1", 0.5, 2.0, 1.0, logarithmic=True, points=4)
_STRIBECK = (
    Shape(
        "stribeck_velocity",
        "{x}/s",
        5e-3,
        0.5,
        0.05,
        logarithmic=True,
        relative_to="speed",
        points=6,
    ),
    Shape("excess_ratio", "1", 0.05, 4.0, 0.6, logarithmic=True, points=2),
)

_DRY = Effect(
    name="coulomb_friction",
    law="smoothed sign",
    family="friction",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("friction_force", "{f}", nonnegative=True),
    shapes=(_SMOOTHING,),
    step=_smoothed_sign,
    sentence="Dry friction of {friction_force} in the guide.",
    compensation="subtract_force",
    derivative_order=1,
    only_in_contact=False,
)
_BY_DIRECTION = replace(
    _DRY,
    law="smoothed sign, by direction",
    shapes=(_SMOOTHING, _BACKWARD),
    step=_sign_by_direction,
    sentence="Dry friction of {friction_force} forward, {backward_ratio} times that backward.",
    like=("coulomb_friction", "force_bias"),
)
_STRIBECK_FRICTION = replace(
    _DRY,
    name="stribeck_friction",
    shapes=(*_STRIBECK, _SMOOTHING),
    step=_stribeck_smoothed,
    sentence="Dry friction of {friction_force} that rises by {excess_ratio} at low speed.",
)

_RIPPLES = (
    Effect(
        name="position_ripple",
        family="ripple",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("ripple", "{f}", nonnegative=True),
        shapes=(
            _PITCH,
            _PHASE,
        ),
        step=_ripple,
        sentence="A ripple of {ripple} repeats every {pitch} of the stroke.",
        compensation="subtract_force",
        only_in_contact=False,
    ),
    Effect(
        name="position_ripple",
        law="of a screw's pitch",
        family="ripple",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude(
            "pitch_error", "{x}", nonnegative=True, lower=0.0, upper=0.1, relative_to="travel"
        ),
        shapes=(_PITCH, _PHASE),
        step=_ripple,
        sentence="The screw is off by {pitch_error}, again and again every {pitch} of the stroke.",
        compensation="correct_position",
        only_in_contact=False,
        acts="moves_position",
    ),
)
EFFECTS = (
    _DRY,
    replace(_DRY, law="presliding", shapes=(_PRESLIDING,), step=_presliding, state_size=1),
    # With presliding, friction of a body alone is its hysteresis: one force, one name.
    replace(
        _DRY,
        law="smoothed sign, in contact",
        sentence="Dry friction of {friction_force} in contact, none in free air.",
        only_in_contact=True,
    ),
    replace(
        _DRY,
        law="smoothed sign, growing with depth",
        amplitude=Amplitude("friction_per_depth", "{f}/{x}", nonnegative=True),
        step=_smoothed_sign_with_depth,
        sentence="Dry friction of {friction_per_depth} in contact, growing with the depth.",
        only_in_contact=True,
    ),
    _BY_DIRECTION,
    replace(
        _BY_DIRECTION,
        law="presliding, by direction",
        shapes=(_PRESLIDING, _BACKWARD),
        step=_presliding_by_direction,
        state_size=1,
    ),
    _STRIBECK_FRICTION,
    replace(
        _STRIBECK_FRICTION,
        law="presliding",
        shapes=(*_STRIBECK, _SHORT_PRESLIDING),
        step=_stribeck_presliding,
        state_size=1,
    ),
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
    Effect(
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
    *_RIPPLES,
    *(
        replace(
            ripple,
            law=f"{ripple.law}, two harmonics".lstrip(", "),
            shapes=(*ripple.shapes, *_SECOND_HARMONIC),
            step=_two_harmonics,
            extends=ripple.law,
        )
        for ripple in _RIPPLES
    ),
)
