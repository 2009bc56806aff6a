"""Tones on the force: of mains, a fan, a pump or a sensor that warms and cools, with harmonics."""

from __future__ import annotations

from dataclasses import replace
from math import cos, pi, sin

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.kernels.jit import kernel


@kernel
def _tone(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return sin(2.0 * pi * eta[0] * t + eta[1])


@kernel
def _three_harmonics(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return sin(u + p) and shares of the sines and cosines of 2u + p and 3u + p, u = 2 pi f t.

    Of any phase p two such rows are those of all, as of a sine alone.
    """
    turn = 2.0 * pi * eta[0] * t
    second, third = 2.0 * turn + eta[1], 3.0 * turn + eta[1]
    harmonics = eta[2] * sin(second) + eta[3] * cos(second)
    harmonics += eta[4] * sin(third) + eta[5] * cos(third)
    return float(sin(turn + eta[1]) + harmonics)


SEEN_IN_AIR = "seen in free air"  # law of a tone that may be as slow as the motion
_PHASE = Shape("phase", "rad", -2 * pi, 2 * pi, 0.0, phase=True)
_TONE = Effect(
    name="periodic_disturbance",
    family="periodic",
    belongs_to="rig",
    stage="sensor",
    amplitude=Amplitude("disturbance", "{f}", nonnegative=True),
    # Where free air does not show it alone, a slower tone is the friction of a periodic motion.
    shapes=(Shape("frequency", "Hz", 1.0, 500.0, 50.0, points=0), _PHASE),
    step=_tone,
    sentence="A disturbance of {disturbance} at {frequency} lies on the force.",
    compensation="subtract_force",
    only_in_contact=False,
)

WITH_HARMONICS = "three harmonics"  # end of the law of a tone that has them
_HARMONICS = tuple(
    Shape(f"{order}_{part}", "1", -1.0, 1.0, 0.0, points=1)
    for order in ("second", "third")
    for part in ("sine", "cosine")
)
_TONES = (
    _TONE,
    replace(
        _TONE,
        law=SEEN_IN_AIR,
        shapes=(Shape("frequency", "Hz", 0.03, 500.0, 50.0, points=0), _PHASE),
    ),
)
EFFECTS = (
    *_TONES,
    *(
        replace(
            tone,
            law=f"{tone.law}, {WITH_HARMONICS}".lstrip(", "),
            shapes=(*tone.shapes, *_HARMONICS),
            step=_three_harmonics,
            extends=tone.law,
        )
        for tone in _TONES
    ),
)
