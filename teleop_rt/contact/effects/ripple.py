"""Ripples along the stroke: of a motor, a screw or an encoder, with a second harmonic."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.kernels.jit import kernel


@kernel
def _ripple(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return sin(2.0 * pi * x / eta[0] + eta[1])


@kernel
def _two_harmonics(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return sin(u + p) + s sin(2u + p) + c cos(2u + p), u = 2 pi x / pitch: of any phase p two."""
    first = 2.0 * pi * x / eta[0] + eta[1]
    second = 2.0 * first - eta[1]
    return float(sin(first) + eta[2] * sin(second) + eta[3] * cos(second))


# A shape that does not repeat within the travel is no ripple: a smooth law makes one and a half
# periods, which fits a stiffening body and predicts nothing.
_PITCH = Shape(
    "pitch", "{x}", 1.0 / 60.0, 0.5, 0.2, reciprocal=True, relative_to="travel", points=118
)
_PHASE = Shape("phase", "rad", -2 * pi, 2 * pi, 0.0, phase=True)
_SECOND_HARMONIC = tuple(
    Shape(name, "1", -1.0, 1.0, 0.0, points=1) for name in ("second_sine", "second_cosine")
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
