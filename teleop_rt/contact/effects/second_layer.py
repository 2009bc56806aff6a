"""Second layers: material that the tool meets beyond a depth."""

from __future__ import annotations

from dataclasses import replace
from math import exp, log1p

from teleop_rt.contact.effect import (
    OF_THE_SPRING,
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    Vector,
)
from teleop_rt.contact.effects.stiffening import CENTRE, SPRING_POWER
from teleop_rt.kernels.jit import kernel


@kernel
def _beyond(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return float(max(x - eta[0], 0.0))


@kernel
def _gradually_beyond(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return x beyond a depth eta[0] that is spread by eta[1], as of an uneven layer."""
    nearer = (x - eta[0]) / eta[1]
    return float(
        eta[1] * (max(nearer, 0.0) + log1p(exp(-abs(nearer))) - log1p(exp(-eta[0] / eta[1])))
    )


@kernel
def _softer_beyond(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -_gradually_beyond(state, x, v, a, t, dt, eta)


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
def _beyond_by_power(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(max(x - eta[0], 0.0) ** eta[1])


_LAYER_DEPTH = Shape("depth", "{x}", 0.05, 0.98, 0.5, relative_to="travel", points=20)
_GRADUAL = Effect(
    name="second_layer",
    law="gradual",  # an interface of two tissues is no plane
    family="stiffening",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("layer_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(
        _LAYER_DEPTH,
        # Spread by more it is a body that stiffens all along.
        Shape(
            "spread",
            "{x}",
            5e-3,
            0.06,
            0.03,
            logarithmic=True,
            relative_to="travel",
            points=3,
            ideal="lower",
        ),
    ),
    step=_gradually_beyond,
    sentence="Below {depth}, within {spread}, a second layer adds {layer_stiffness}.",
    compensation="render",
    extends="",
)
_HELD_LAYER = Effect(
    name="second_layer",
    law=WITHOUT_CONTACT,  # from beyond the stroke on one side alone
    family="stiffening",
    belongs_to="environment",
    stage="material",
    amplitude=Amplitude("layer_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(
        replace(CENTRE, points=3),
        Shape("depth", "{x}", 0.05, 2.9, 0.5, relative_to="travel", points=20),
    ),
    step=_beyond_on_both_sides,
    sentence="Beyond {depth} from {centre} a second layer adds {layer_stiffness}.",
    compensation="render",
    only_in_contact=False,
)
EFFECTS = (
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
    _GRADUAL,
    replace(
        _GRADUAL,
        law="softer",  # fat below a skin, or a foam below a crust
        step=_softer_beyond,
        sentence="Below {depth}, within {spread}, a second layer is softer by {layer_stiffness}.",
        extends=None,
    ),
    Effect(
        name="second_layer",
        law=f"rounded {OF_THE_SPRING}",
        family="stiffening",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("layer_stiffness", "{f}/{x}^power", nonnegative=True),
        # A lump in a cone's body need not have the power of that body.
        shapes=(_LAYER_DEPTH, replace(SPRING_POWER, points=2)),
        step=_beyond_by_power,
        sentence="Below {depth} a rounded second layer adds {layer_stiffness}.",
        compensation="render",
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
)
