"""Material effects that act through the depth alone, or through depth and time."""

from __future__ import annotations

from dataclasses import replace
from math import exp

from teleop_rt.contact.effect import WITHOUT_CONTACT, Amplitude, Effect, Shape, Vector
from teleop_rt.contact.law import spring_force, touches
from teleop_rt.jit import kernel


@kernel
def _power(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return spring_force(max(x, 0.0), 1.0, eta[0])


@kernel
def _exponential(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    ratio = min(max(x, 0.0) / eta[0], 50.0)
    return float(exp(ratio) - 1.0 - ratio)


@kernel
def _levelling(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    depth = max(x, 0.0)
    return float(depth / (1.0 + (depth / eta[0]) ** eta[1]) ** (1.0 / eta[1]))


@kernel
def _cubic(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return float((x - eta[0]) ** 3)


@kernel
def _odd_power(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    beside = x - eta[0]
    return float(abs(beside) ** eta[1] if beside > 0.0 else -(abs(beside) ** eta[1]))


@kernel
def _beyond(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return float(max(x - eta[0], 0.0))


@kernel
def _beyond_on_both_sides(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    beside = x - eta[0]
    further = max(abs(beside) - eta[1], 0.0)
    return float(further if beside > 0.0 else -further)


@kernel
def _rounded_on_both_sides(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    beside = x - eta[0]
    further = max(abs(beside) - eta[1], 0.0) ** 1.5
    return float(further if beside > 0.0 else -further)


@kernel
def _rounded_beyond(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x - eta[0], 0.0) ** 1.5)


@kernel
def _weakened(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -max(x, 0.0) * (1.0 - exp(-t / eta[0]))


@kernel
def _weakened_alike(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -max(x + eta[1] * v, 0.0) * (1.0 - exp(-t / eta[0])) if touches(x) else 0.0


@kernel
def _weakened_on_both_sides(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float((eta[0] - x) * (1.0 - exp(-t / eta[1])))


@kernel
def _weakened_alike_on_both_sides(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float((eta[0] - x - eta[2] * v) * (1.0 - exp(-t / eta[1])))


@kernel
def _weakened_by_load(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    if not touches(x):
        return 0.0
    state[0] += x * dt
    return float(-max(x + eta[1] * v, 0.0) * eta[0] * (1.0 - exp(-state[0] / eta[0])))


# From beyond the stroke a power is one of a spring that only stiffens inwards. Of an odd number of
# places one is the middle, about which a held body is most often alike on both sides.
_CENTRE = Shape("centre", "{x}", -2.0, 2.0, 0.0, relative_to="place", points=9)
_LAYER_DEPTH = Shape("depth", "{x}", 0.05, 0.98, 0.5, relative_to="travel", points=20)
_HELD_LAYER = Effect(
    name="second_layer",
    law=WITHOUT_CONTACT,  # from beyond the stroke on one side alone
    family="stiffening",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("layer_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(
        replace(_CENTRE, points=3),
        Shape("depth", "{x}", 0.05, 2.9, 0.5, relative_to="travel", points=20),
    ),
    step=_beyond_on_both_sides,
    sentence="Beyond {depth} from {centre} a second layer adds {layer_stiffness}.",
    compensation="render",
    only_in_contact=False,
)
# Damping over stiffness, which heat and damage lower alike.
_DAMPING_TIME = Shape("damping_time", "s", 1e-3, 0.2, 1e-2, logarithmic=True, points=4)
_LOSS_TIME = Shape(
    "time_constant",
    "s",
    0.03,
    5.0,
    0.5,
    logarithmic=True,
    relative_to="duration",
    points=8,
)
_HELD_SOFTENING = Effect(
    name="softening",
    law=WITHOUT_CONTACT,
    family="drift",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("stiffness_lost", "{f}/{x}"),
    shapes=(replace(_CENTRE, points=3), _LOSS_TIME),
    step=_weakened_on_both_sides,
    sentence="Within {time_constant} the stiffness about {centre} falls by {stiffness_lost}.",
    compensation="render",
    only_in_contact=False,
)
EFFECTS = (
    Effect(
        name="nonlinear_stiffening",
        law="power",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffening", "{f}/{x}^power", nonnegative=True),
        shapes=(Shape("power", "1", 1.4, 6.0, 2.5, points=7),),
        step=_power,
        sentence="The material stiffens with depth, with the power {power}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law="softening tangent",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(Shape("power", "1", 0.25, 0.85, 0.5, points=3),),
        step=_power,
        sentence="The material's tangent falls with depth, with the power {power}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law="levelling off",  # a foam whose cells buckle
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness", "{f}/{x}", nonnegative=True),
        shapes=(
            Shape("length", "{x}", 0.1, 2.0, 0.5, logarithmic=True, relative_to="travel", points=6),
            Shape("sharpness", "1", 1.2, 10.0, 3.0, logarithmic=True, points=2, ideal="upper"),
        ),
        step=_levelling,
        sentence="A stiffness of {stiffness} levels off beyond {length}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law="exponential",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffening", "{f}", nonnegative=True),
        shapes=(
            Shape(
                "length", "{x}", 0.05, 2.0, 0.4, logarithmic=True, relative_to="travel", points=5
            ),
        ),
        step=_exponential,
        sentence="The material stiffens with depth, by e every {length}.",
        compensation="render",
    ),
    Effect(
        name="nonlinear_stiffening",
        law=WITHOUT_CONTACT,
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("cubic_stiffness", "{f}/{x}^3"),
        shapes=(_CENTRE,),
        step=_cubic,
        sentence="The stiffness changes by {cubic_stiffness} about {centre}.",
        compensation="render",
        only_in_contact=False,
    ),
    Effect(
        name="nonlinear_stiffening",
        law=f"{WITHOUT_CONTACT}, power",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffening", "{f}/{x}^power"),
        shapes=(_CENTRE, Shape("power", "1", 1.3, 6.0, 3.0, points=4)),
        step=_odd_power,
        sentence="The stiffness changes about {centre}, with the power {power}.",
        compensation="render",
        only_in_contact=False,
        extends=WITHOUT_CONTACT,
    ),
    Effect(
        name="second_layer",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("layer_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_LAYER_DEPTH,),
        step=_beyond,
        sentence="Below {depth} a second layer adds {layer_stiffness}.",
        compensation="render",
    ),
    Effect(
        name="second_layer",
        law="rounded",  # a lump, or a rounded tip that meets it (Hertz 1882)
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("layer_stiffness", "{f}/{x}^1.5", nonnegative=True),
        shapes=(_LAYER_DEPTH,),
        step=_rounded_beyond,
        sentence="Below {depth} a rounded second layer adds {layer_stiffness}.",
        compensation="render",
        extends="",
    ),
    _HELD_LAYER,
    replace(
        _HELD_LAYER,
        law=f"{WITHOUT_CONTACT}, rounded",
        amplitude=Amplitude("layer_stiffness", "{f}/{x}^1.5", nonnegative=True),
        step=_rounded_on_both_sides,
        sentence="Beyond {depth} from {centre} a rounded second layer adds {layer_stiffness}.",
        extends=WITHOUT_CONTACT,
    ),
    Effect(
        name="softening",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}"),
        shapes=(_LOSS_TIME,),
        step=_weakened,
        sentence="Within {time_constant} the stiffness falls by {stiffness_lost}.",
        compensation="render",
    ),
    Effect(
        name="softening",
        law="of stiffness and damping",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}"),
        shapes=(_LOSS_TIME, _DAMPING_TIME),
        step=_weakened_alike,
        sentence=(
            "Within {time_constant} the stiffness falls by {stiffness_lost}, the damping by"
            " {damping_time} times that."
        ),
        compensation="render",
        derivative_order=1,
    ),
    _HELD_SOFTENING,
    replace(
        _HELD_SOFTENING,
        law=f"{WITHOUT_CONTACT}, of stiffness and damping",
        shapes=(*_HELD_SOFTENING.shapes, _DAMPING_TIME),
        step=_weakened_alike_on_both_sides,
        sentence=(
            "Within {time_constant} the stiffness about {centre} falls by {stiffness_lost}, the"
            " damping by {damping_time} times that."
        ),
        derivative_order=1,
        extends=WITHOUT_CONTACT,
    ),
    Effect(
        name="softening",
        law="of stiffness and damping by load",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("loss_rate", "{f}/({x}^2 s)"),
        shapes=(
            Shape(
                "load_time",
                "{x} s",
                0.3,
                100.0,
                5.0,
                logarithmic=True,
                relative_to="travel",
                points=8,
                ideal="upper",
            ),
            _DAMPING_TIME,
        ),
        step=_weakened_by_load,
        state_size=1,
        sentence=(
            "Load takes {loss_rate} off the stiffness, less after {load_time} of it, and"
            " {damping_time} times that off the damping."
        ),
        compensation="render",
        derivative_order=1,
    ),
)
