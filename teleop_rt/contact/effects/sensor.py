"""Effects of the force channel: the recorded value differs from the force."""

from __future__ import annotations

from dataclasses import replace
from math import cos, exp, pi, sin, sqrt

from teleop_rt.contact.effect import WITHOUT_CONTACT, Amplitude, Effect, Shape, Vector
from teleop_rt.contact.effects.softening import LOSS_TIME
from teleop_rt.kernels.jit import kernel


@kernel
def _one(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    return 1.0


@kernel
def _low_pass(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance a first-order low-pass, exact for an input that is linear between samples."""
    if state[2] == 0.0:
        state[2] = 1.0
        state[0] = x
        state[1] = x
    ratio = 2.0 * pi * eta[0] * dt
    decay = exp(-ratio)
    slope = (x - state[1]) / ratio
    state[0] = decay * (state[0] - state[1] + slope) + x - slope
    state[1] = x
    return float(state[0])


@kernel
def _low_pass_of_two(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance a second-order low-pass, exact for an input that is linear between samples.

    eta: bandwidth and damping ratio (below 1); state: output, its rate, last input, a start flag.
    """
    if state[3] == 0.0:
        state[3] = 1.0
        state[0] = x
        state[2] = x
    natural, damping = 2.0 * pi * eta[0], eta[1]
    decay, turn = natural * damping, natural * sqrt(1.0 - damping * damping)
    slope = (x - state[2]) / dt
    lag = 2.0 * damping * slope / natural
    # The past swings and fades beside the steady answer to a ramp.
    gap, rate = state[0] - state[2] + lag, state[1] - slope
    fade, cosine, sine = exp(-decay * dt), cos(turn * dt), sin(turn * dt) / turn
    state[0] = x - lag + fade * (gap * (cosine + decay * sine) + rate * sine)
    state[1] = slope + fade * (rate * (cosine - decay * sine) - gap * natural * natural * sine)
    state[2] = x
    return float(state[0])


@kernel
def _drifting_gain(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(x * (1.0 + eta[0] * (1.0 - exp(-t / eta[1]))))


@kernel
def _high_pass(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance a first-order high-pass, exact for an input that is linear between samples.

    eta: time constant; state: output, last input, a start flag. It starts as an amplifier that is
    reset without load.
    """
    if state[2] == 0.0:
        state[2] = 1.0
        state[1] = x
    decay = exp(-dt / eta[0])
    state[0] = decay * state[0] + (x - state[1]) / dt * eta[0] * (1.0 - decay)
    state[1] = x
    return float(state[0])


@kernel
def _clipped(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(min(max(x, -eta[0]), eta[0]))


@kernel
def _clipped_between(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(min(max(x, eta[1]), eta[0]))


@kernel
def _softly_clipped(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Bend at the level; a rounder bend than a sharpness of 4 is a law of its own, as friction."""
    return float(x / (1.0 + abs(x / eta[0]) ** eta[1]) ** (1.0 / eta[1]))


_UNITY = Amplitude("scale", "1", unity=True)
AT_TWO_ENDS = f"{WITHOUT_CONTACT}, at its two ends"
_LEAST_LEVEL = 0.85
"""Of the largest force read [1]: nothing is read beyond the level but noise."""
_HARD = Effect(
    name="force_saturation",
    law="hard",
    family="saturation",
    belongs_to="rig",
    stage="sensor",
    amplitude=_UNITY,
    shapes=(Shape("level", "{f}", _LEAST_LEVEL, 1.02, 0.9, relative_to="force", points=6),),
    step=_clipped,
    sentence="The force channel saturates at {level}.",
    compensation="mask",
    only_in_contact=False,
    acts="limits_force",
)
_LEAST_END, _OPEN_END = 0.95, 1.1
"""Of half the range of the readings [1], a thousandth of them aside at either end: the least that
an end of the channel may be, since noise is read beyond it, and one that limits nothing."""
# Without load a channel rarely reads the middle of its range: its ends lie unevenly about 0.
_HIGHEST = Shape(
    "highest", "{f}", _LEAST_END, _OPEN_END, 1.0, relative_to="range", points=3, ideal="upper"
)
_LOWEST = replace(
    _HIGHEST, name="lowest", lower=-_OPEN_END, upper=-_LEAST_END, start=-1.0, ideal="lower"
)

# Up to a fifth of a millisecond: a smaller delay and a smaller lag are one force.
_BANDWIDTH = Shape("bandwidth", "Hz", 0.5, 2000.0, 30.0, logarithmic=True, points=12)
FIRST_ORDER_LAG = Effect(
    name="force_lag",
    law="first order",
    family="delay",
    belongs_to="rig",
    stage="sensor",
    amplitude=_UNITY,
    shapes=(_BANDWIDTH,),
    step=_low_pass,
    sentence="The force channel is slow: first order, {bandwidth}.",
    compensation="shift_time",
    state_size=3,
    only_in_contact=False,
    acts="filters_force",
)


def range_of(effect: Effect, eta: Vector) -> tuple[float, float]:
    """Return the middle and half the width [rig unit] of the range of a channel that saturates."""
    level = float(eta[0])
    lowest = float(eta[1]) if effect.law == AT_TWO_ENDS else -level
    return 0.5 * (level + lowest), 0.5 * (level - lowest)


EFFECTS = (
    FIRST_ORDER_LAG,
    Effect(
        name="force_lag",
        law="second order",
        family="delay",
        belongs_to="rig",
        stage="sensor",
        amplitude=_UNITY,
        shapes=(
            replace(_BANDWIDTH, points=10),
            Shape("damping_ratio", "1", 0.3, 0.99, 0.75, points=2, ideal="upper"),
        ),
        step=_low_pass_of_two,
        sentence="The force channel is slow: second order, {bandwidth}, damped by {damping_ratio}.",
        compensation="shift_time",
        state_size=4,
        only_in_contact=False,
        acts="filters_force",
    ),
    # An amplifier that warms. A body that softens as a whole reads the same, and so both are named.
    Effect(
        name="gain_drift",
        family="drift",
        belongs_to="rig",
        stage="sensor",
        amplitude=_UNITY,
        shapes=(
            Shape("gain_change", "1", -0.7, 1.5, 0.1, points=4, neutral=0.0),
            replace(LOSS_TIME, points=4, ideal="upper"),
        ),
        step=_drifting_gain,
        sentence="Within {time_constant} the gain of the force channel changes by {gain_change}.",
        compensation="none",
        only_in_contact=False,
        acts="filters_force",
    ),
    # A piezoelectric sensor: its charge leaks, and the force falls below zero after a release.
    Effect(
        name="charge_leak",
        family="drift",
        belongs_to="rig",
        stage="sensor",
        amplitude=_UNITY,
        shapes=(replace(LOSS_TIME, points=8, ideal="upper"),),
        step=_high_pass,
        sentence="The force channel forgets a constant force within {time_constant}.",
        compensation="none",
        state_size=3,
        only_in_contact=False,
        acts="filters_force",
    ),
    _HARD,
    replace(
        _HARD,
        law=AT_TWO_ENDS,
        shapes=(_HIGHEST, _LOWEST),
        step=_clipped_between,
        sentence="The force channel saturates at {lowest} and at {highest}.",
    ),
    Effect(
        name="force_saturation",
        law="soft",
        family="saturation",
        belongs_to="rig",
        stage="sensor",
        amplitude=_UNITY,
        shapes=(
            Shape(
                "level",
                "{f}",
                _LEAST_LEVEL,
                3.0,
                1.1,
                logarithmic=True,
                relative_to="force",
                points=6,
            ),
            Shape("sharpness", "1", 4.0, 30.0, 8.0, logarithmic=True, points=2, ideal="upper"),
        ),
        step=_softly_clipped,
        sentence="The force channel saturates softly towards {level}.",
        compensation="mask",
        only_in_contact=False,
        acts="limits_force",
    ),
    Effect(
        name="outliers",
        family="outliers",
        belongs_to="rig",
        stage="sensor",
        amplitude=Amplitude("share", "1", nonnegative=True),
        step=_one,
        sentence="A share of {share} of the samples are isolated outliers.",
        compensation="mask",
        only_in_contact=False,
        acts="limits_force",
    ),
)
