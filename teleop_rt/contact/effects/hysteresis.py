"""Materials that remember their last reversals: hysteresis, smooth or by sliders."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

from teleop_rt.contact.effect import (
    OF_THE_SPRING,
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    Vector,
)
from teleop_rt.contact.effects.friction import (
    SMOOTHING,
    presliding,
    smoothed_sign_beside_rest,
    smoothed_sign_with_depth,
    smoothed_sign_with_spring,
)
from teleop_rt.contact.effects.stiffening import CENTRE, SPRING_POWER
from teleop_rt.contact.law import spring_force, touches
from teleop_rt.kernels.jit import kernel

_SLIDERS = 6  # elements of an Iwan model, with yield travels in geometric steps


@kernel
def _bouc_wen_everywhere(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance z' = v/d (1 - |z|^n (1 + sgn(v z))/2), Bouc-Wen with beta = gamma = 1/2."""
    steps = 1 + int(min(abs(v) * dt / (0.2 * eta[0]), 20.0))
    h = v * dt / (eta[0] * steps)
    for _ in range(steps):
        z = state[0]
        if h * z > 0.0:
            z += h * (1.0 - abs(z) ** eta[1])
        else:
            z += h
        state[0] = min(max(z, -1.0), 1.0)
    return float(state[0])


@kernel
def _bouc_wen(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance the same in contact; beside it the body keeps its stretch."""
    return _bouc_wen_everywhere(state, x, v, a, t, dt, eta) if touches(x) else float(state[0])


@kernel
def _bouc_wen_from_zero(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance z' = v/d (1 - |z|^n (1 - u + (1 + u) sgn(v z))/2), from 0 at each contact.

    eta: d, n, and u = beta - gamma (Bouc and Wen): 0 unloads along a line, 1 is Dahl's model.
    state: z, then 1 in contact.
    """
    if not touches(x):
        state[0] = state[1] = 0.0
        return 0.0
    moved = v * dt if state[1] > 0.0 else x  # of the first step only the part in contact
    state[1] = 1.0
    steps = 1 + int(min(abs(moved) / (0.2 * eta[0]), 20.0))
    h = moved / (eta[0] * steps)
    for _ in range(steps):
        middle = state[0] + 0.5 * h * _slope(state[0], h, eta)
        state[0] = min(max(state[0] + h * _slope(middle, h, eta), -1.0), 1.0)
    return float(state[0])


@kernel
def _slope(z: float, h: float, eta: Vector) -> float:
    """Return z' d/v on the way of a step h [1]; eta as of `_bouc_wen_from_zero`."""
    return float(1.0 + (-1.0 if h * z > 0.0 else eta[2]) * abs(z) ** eta[1])


@kernel
def _bouc_wen_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _bouc_wen(state, x, v, a, t, dt, eta) * max(x, 0.0)


@kernel
def _stretched(state: Vector, x: float, eta: Vector) -> float:
    moved = x - state[_SLIDERS]
    state[_SLIDERS] = x
    ratio, travel = eta[1] ** (-1.0 / (_SLIDERS - 1)), eta[0]
    held = most = 0.0
    for i in range(_SLIDERS):
        state[i] = min(max(state[i] + moved, -travel), travel)
        held += state[i]
        most += travel
        travel *= ratio
    return held / most


@kernel
def _slipping(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Stretch springs in parallel, each of which slips at a travel of its own (Iwan 1966).

    Their travels lie evenly in the logarithm, from the largest, eta[0], down to that over eta[1];
    the force is per unit of the most that they hold together. state: stretches, then last
    penetration.
    """
    return _stretched(state, max(x, 0.0), eta)


@kernel
def _slipping_everywhere(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Stretch the same springs on both sides of 0, from where the recording begins."""
    if state[_SLIDERS + 1] == 0.0:
        state[_SLIDERS + 1] = 1.0
        state[_SLIDERS] = x
    return _stretched(state, x, eta)


@kernel
def _slipping_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _slipping(state, x, v, a, t, dt, eta) * max(x, 0.0)


@kernel
def _bouc_wen_with_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _bouc_wen(state, x, v, a, t, dt, eta) * spring_force(max(x, 0.0), 1.0, eta[2])


@kernel
def _slipping_with_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _slipping(state, x, v, a, t, dt, eta) * spring_force(max(x, 0.0), 1.0, eta[2])


_YIELD = Shape(
    "yield_travel", "{x}", 3e-3, 0.6, 0.05, logarithmic=True, relative_to="travel", points=8
)
_ALIKE = 1.5  # spread of sliders, below which they are as one
_SPREAD = Shape("spread", "1", 1.0, 60.0, 10.0, logarithmic=True, points=2, ideal="lower")
_SHARPNESS = Shape("sharpness", "1", 0.6, 5.0, 1.0, logarithmic=True, points=2, ideal="upper")
_UNLOADING = Shape("unloading", "1", -0.5, 1.0, 0.3, points=2)
_AS_FRICTION = (
    "A hysteretic force of {yield_force}, as of dry friction in contact alone, turns over"
    " within {yield_travel}."
)
_memory = partial(
    Effect, family="hysteresis", belongs_to="environment", stage="material", compensation="render"
)
# Friction of a guide that the contact loads is the same force: the data cannot separate the names.
_STRUCTURAL = _memory(
    name="hysteresis",
    law="structural, growing with depth",
    amplitude=Amplitude("loss_stiffness", "{f}/{x}", nonnegative=True),
    shapes=(SMOOTHING,),
    step=smoothed_sign_with_depth,
    sentence="Structural damping of {loss_stiffness}: depth times the sign of the speed (Reid).",
)
_ON_BOTH_SIDES = _memory(
    name="hysteresis",
    law=WITHOUT_CONTACT,
    amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
    shapes=(_YIELD, replace(_SPREAD, lower=_ALIKE, ideal="")),
    step=_slipping_everywhere,
    sentence="A hysteretic force of {yield_force} turns over within {yield_travel}.",
    state_size=_SLIDERS + 2,
    only_in_contact=False,
)

EFFECTS = (
    _memory(
        name="hysteresis",
        law="plain",
        amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
        shapes=(_YIELD, _SHARPNESS),
        step=_bouc_wen,
        sentence=_AS_FRICTION,
        state_size=1,
        derivative_order=1,
    ),
    _memory(
        name="hysteresis",
        law="from zero at each contact",
        amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
        shapes=(_YIELD, _SHARPNESS, _UNLOADING),
        step=_bouc_wen_from_zero,
        sentence=_AS_FRICTION,
        state_size=2,
        derivative_order=1,
        extends="plain",
    ),
    _memory(
        name="hysteresis",
        law="growing with depth",
        amplitude=Amplitude("yield_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_YIELD, _SHARPNESS),
        step=_bouc_wen_with_depth,
        sentence="A hysteretic force of {yield_stiffness} turns over within {yield_travel}.",
        state_size=1,
        derivative_order=1,
    ),
    _memory(
        name="hysteresis",
        law="sliders",
        amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
        shapes=(_YIELD, _SPREAD),
        step=_slipping,
        sentence=_AS_FRICTION,
        state_size=_SLIDERS + 1,
    ),
    _ON_BOTH_SIDES,
    replace(
        _ON_BOTH_SIDES,
        law=f"{WITHOUT_CONTACT}, sliders alike",  # of more than half the travel one may be a spring
        shapes=(replace(_YIELD, upper=0.45), replace(_SPREAD, upper=_ALIKE, start=1.1, points=1)),
    ),
    _memory(
        name="hysteresis",
        law=f"{WITHOUT_CONTACT}, Bouc and Wen",
        amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
        shapes=(replace(_YIELD, lower=0.02, points=5), replace(_SHARPNESS, ideal="")),
        step=_bouc_wen_everywhere,
        sentence="A hysteretic force of {yield_force} turns over within {yield_travel}.",
        state_size=1,
        only_in_contact=False,
        derivative_order=1,
    ),
    _memory(
        name="hysteresis",
        law=f"{WITHOUT_CONTACT}, one slider",  # Dahl's; with less travel it is dry friction
        amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
        shapes=(replace(_YIELD, lower=0.05),),
        step=presliding,
        sentence="A hysteretic force of {yield_force} turns over within {yield_travel}.",
        state_size=1,
        only_in_contact=False,
    ),
    _memory(
        name="hysteresis",
        law="sliders, growing with depth",
        amplitude=Amplitude("yield_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_YIELD, _SPREAD),
        step=_slipping_with_depth,
        sentence="A hysteretic force of {yield_stiffness} turns over within {yield_travel}.",
        state_size=_SLIDERS + 1,
    ),
    _memory(
        name="hysteresis",
        law=f"growing with depth {OF_THE_SPRING}",
        amplitude=Amplitude("yield_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(_YIELD, _SHARPNESS, SPRING_POWER),
        step=_bouc_wen_with_spring,
        sentence="A hysteretic force of {yield_stiffness} turns over within {yield_travel}.",
        state_size=1,
        derivative_order=1,
    ),
    _memory(
        name="hysteresis",
        law=f"sliders, growing with depth {OF_THE_SPRING}",
        amplitude=Amplitude("yield_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(_YIELD, _SPREAD, SPRING_POWER),
        step=_slipping_with_spring,
        sentence="A hysteretic force of {yield_stiffness} turns over within {yield_travel}.",
        state_size=_SLIDERS + 1,
    ),
    _STRUCTURAL,
    replace(
        _STRUCTURAL,
        law=f"{WITHOUT_CONTACT}, structural",
        shapes=(replace(CENTRE, points=5), SMOOTHING),
        step=smoothed_sign_beside_rest,
        sentence=(
            "Structural damping of {loss_stiffness}: the way from {centre} times the sign of the"
            " speed (Reid)."
        ),
        only_in_contact=False,
    ),
    replace(
        _STRUCTURAL,
        law=f"structural, growing with depth {OF_THE_SPRING}",
        amplitude=Amplitude("loss_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(SMOOTHING, SPRING_POWER),
        step=smoothed_sign_with_spring,
    ),
)
