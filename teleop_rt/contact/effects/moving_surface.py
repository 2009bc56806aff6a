"""A surface that moves: it recedes, settles, swings or beats."""

from __future__ import annotations

from dataclasses import replace
from math import cos, expm1, pi, sin

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.kernels.jit import kernel


@kernel
def _receding(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -t


@kernel
def _settling(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(eta[0] * expm1(-t / eta[0]))


@kernel
def _swinging(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -sin(2.0 * pi * eta[0] * t + eta[1])


@kernel
def _swinging_away(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(-sin(2.0 * pi * eta[0] * t + eta[1]) - eta[2] * t)


@kernel
def _beating(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return a swing with its second and third harmonic, as that of a heart."""
    turn = 2.0 * pi * eta[0] * t + eta[1]
    second = eta[2] * sin(2.0 * turn) + eta[3] * cos(2.0 * turn)
    third = eta[4] * sin(3.0 * turn) + eta[5] * cos(3.0 * turn)
    return float(-sin(turn) - second - third)


@kernel
def _beating_twice(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return a beat by its second harmonic, which may be the strongest, with first and third."""
    turn = 2.0 * pi * eta[0] * t + eta[1]
    first = eta[2] * sin(0.5 * turn) + eta[3] * cos(0.5 * turn)
    third = eta[4] * sin(1.5 * turn) + eta[5] * cos(1.5 * turn)
    return float(-sin(turn) - first - third)


_SWINGING = Effect(
    name="moving_surface",
    law="swinging",
    family="drift",
    belongs_to="environment",
    stage="kinematics",
    amplitude=Amplitude(
        "swing", "{x}", nonnegative=True, lower=0.0, upper=0.3, relative_to="travel", points=2
    ),
    shapes=(
        Shape("frequency", "Hz", 0.05, 5.0, 0.5, points=0),
        Shape("phase", "rad", -2 * pi, 2 * pi, 0.0, phase=True),
    ),
    step=_swinging,
    sentence="The surface swings by {swing} at {frequency}.",
    compensation="render",
    only_in_contact=False,
    acts="moves_position",
)
_STEADY = Effect(
    name="moving_surface",
    law="steady",
    family="drift",
    belongs_to="environment",
    stage="kinematics",
    amplitude=Amplitude(
        "surface_velocity", "{x}/s", lower=-0.05, upper=0.05, relative_to="speed", points=6
    ),
    step=_receding,
    sentence="The surface recedes at {surface_velocity}.",
    turned="The surface comes nearer at {-surface_velocity}.",
    compensation="render",
    only_in_contact=False,
    acts="moves_position",
)


def _harmonics(*orders: str) -> tuple[Shape, ...]:
    """Return the harmonics of a beat, as multiples of the swing."""
    parts = [f"{order}_{part}" for order in orders for part in ("sine", "cosine")]
    return tuple(Shape(part, "1", -2.0, 2.0, 0.0, points=2) for part in parts)


EFFECTS = (
    _STEADY,
    replace(
        _STEADY,
        law="settling",
        shapes=(
            Shape(
                "settling_time",
                "s",
                0.03,
                3.0,
                0.3,
                logarithmic=True,
                relative_to="duration",
                points=3,
                ideal="upper",
            ),
        ),
        step=_settling,
        sentence="The surface recedes, at first at {surface_velocity}, and settles within"
        " {settling_time}.",
        turned="The surface comes nearer, at first at {-surface_velocity}, and settles within"
        " {settling_time}.",
    ),
    _SWINGING,
    replace(
        _SWINGING,
        law="swinging and receding",
        shapes=(*_SWINGING.shapes, Shape("swings_receded", "1/s", -1.0, 1.0, 0.0, points=2)),
        step=_swinging_away,
        sentence="The surface swings by {swing} at {frequency}, and recedes by {swings_receded} of"
        " its swing.",
        extends=_SWINGING.law,
    ),
    replace(
        _SWINGING,
        law="beating",
        shapes=(*_SWINGING.shapes, *_harmonics("second", "third")),
        step=_beating,
        sentence="The surface beats by {swing} at {frequency}, with harmonics.",
        extends=_SWINGING.law,
    ),
    replace(
        _SWINGING,
        law="beating twice",
        shapes=(*_SWINGING.shapes, *_harmonics("first", "third")),
        step=_beating_twice,
        sentence="The surface beats by {swing} at {frequency}, the second harmonic of its beat.",
        extends=_SWINGING.law,
    ),
)
