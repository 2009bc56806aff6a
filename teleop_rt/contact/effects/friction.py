"""Dry friction of the tool and its guide, and of a body in contact."""

from __future__ import annotations

from dataclasses import replace
from math import exp, tanh

from teleop_rt.contact.effect import (
    OF_THE_SPRING,
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    Vector,
)
from teleop_rt.contact.effects.stiffening import CENTRE, SPRING_POWER
from teleop_rt.contact.law import spring_force
from teleop_rt.kernels.jit import kernel

UNDER_LOAD = "under load"
"""End of the name of a law of the guide that the depth in a body changes."""


@kernel
def _smoothed_sign(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return tanh(v / eta[0])


@kernel
def smoothed_sign_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return the sign of the speed, smoothed, times the depth."""
    return float(tanh(v / eta[0]) * max(x, 0.0))


@kernel
def smoothed_sign_beside_rest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return the sign of the speed, smoothed, times the distance from the rest of a held body."""
    return float(tanh(v / eta[1]) * abs(x - eta[0]))


@kernel
def smoothed_sign_with_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return the sign of the speed, smoothed, times the depth to a power."""
    return tanh(v / eta[0]) * spring_force(max(x, 0.0), 1.0, eta[1])


@kernel
def presliding(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance Dahl's z' = v/d (1 - z sgn v): elastic before it slides; exact over a sample."""
    sign = 1.0 if v > 0.0 else -1.0
    state[0] = sign + (state[0] - sign) * exp(-abs(v) * dt / eta[0])
    return float(state[0])


@kernel
def _damped_presliding(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance Dahl's z and return z + tau z': bristles that are damped (LuGre's sigma 1)."""
    before = state[0]
    bent = presliding(state, x, v, a, t, dt, eta)
    return float(bent + eta[1] * (bent - before) / dt)


@kernel
def _sliding_behind_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance a dry slider behind a spring: elastic until it slides, then at its full force."""
    state[0] = min(max(state[0] + v * dt / eta[0], -1.0), 1.0)
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
def _sliding_behind_spring_by_direction(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    state[0] = min(max(state[0] + v * dt / eta[0], -eta[1]), 1.0)
    return float(state[0])


@kernel
def _sign_under_load(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(tanh(v / eta[0]) * (1.0 + max(x, 0.0) / eta[1]))


@kernel
def _presliding_under_load(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance Dahl's z with a goal that grows with the depth."""
    goal = (1.0 if v > 0.0 else -1.0) * (1.0 + max(x, 0.0) / eta[1])
    state[0] = goal + (state[0] - goal) * exp(-abs(v) * dt / eta[0])
    return float(state[0])


SMOOTHING = Shape(
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
PRESLIDING = Shape(
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
# Damping of bristles over their stiffness: LuGre's own example has 3 ms.
BRISTLE_TIME = Shape("bristle_time", "s", 2e-4, 0.02, 2e-3, logarithmic=True, points=3,
                      ideal="lower")  # fmt: skip
# Beyond twice as much in one direction it would be a bias with some friction, not friction.
_BACKWARD = Shape("backward_ratio", "1", 0.5, 2.0, 1.0, logarithmic=True, points=4)
# Seals and rollers are pressed by the load that the drive carries.
_DOUBLING = Shape("doubling_depth", "{x}", 0.05, 20.0, 1.0, logarithmic=True, relative_to="travel",
                  points=3, ideal="upper")  # fmt: skip
DRY = Effect(
    name="coulomb_friction",
    law="smoothed sign",
    family="friction",
    belongs_to="rig",
    stage="tool",
    amplitude=Amplitude("friction_force", "{f}", nonnegative=True),
    shapes=(SMOOTHING,),
    step=_smoothed_sign,
    sentence="Dry friction of {friction_force} in the guide.",
    compensation="subtract_force",
    derivative_order=1,
    only_in_contact=False,
)
_BY_DIRECTION = replace(
    DRY,
    law="smoothed sign, by direction",
    shapes=(SMOOTHING, _BACKWARD),
    step=_sign_by_direction,
    sentence="Dry friction of {friction_force} forward, {backward_ratio} times that backward.",
    like=("coulomb_friction", "force_bias"),
)
_UNDER_LOAD = replace(
    DRY,
    law=f"smoothed sign, {UNDER_LOAD}",
    shapes=(SMOOTHING, _DOUBLING),
    step=_sign_under_load,
    sentence=(
        "Dry friction of {friction_force} in the guide, twice that where the tool presses"
        " {doubling_depth} deep."
    ),
    extends="smoothed sign",
)

EFFECTS = (
    DRY,
    replace(DRY, law="presliding", shapes=(PRESLIDING,), step=presliding, state_size=1),
    replace(
        DRY,
        law="presliding, damped",
        shapes=(PRESLIDING, BRISTLE_TIME),
        step=_damped_presliding,
        state_size=1,
        extends="presliding",
    ),
    replace(
        DRY,
        law="behind a spring",
        shapes=(PRESLIDING,),
        step=_sliding_behind_spring,
        sentence="Dry friction of {friction_force}; its joint gives {presliding_travel} first.",
        state_size=1,
    ),
    # With presliding, friction of a body alone is its hysteresis: one force, one name.
    replace(
        DRY,
        law="smoothed sign, in contact",
        sentence="Dry friction of {friction_force} in contact, none in free air.",
        only_in_contact=True,
    ),
    replace(
        DRY,
        law="smoothed sign, growing with depth",
        amplitude=Amplitude("friction_per_depth", "{f}/{x}", nonnegative=True),
        step=smoothed_sign_with_depth,
        sentence="Dry friction of {friction_per_depth} in contact, growing with the depth.",
        only_in_contact=True,
    ),
    replace(
        DRY,
        law=f"smoothed sign, growing with depth {OF_THE_SPRING}",
        amplitude=Amplitude("friction_per_depth", "{f}/{x}^power", nonnegative=True),
        shapes=(SMOOTHING, SPRING_POWER),
        step=smoothed_sign_with_spring,
        sentence="Dry friction of {friction_per_depth} in contact, growing with the force.",
        only_in_contact=True,
    ),
    replace(
        DRY,
        law=f"{WITHOUT_CONTACT}, growing beside the rest",
        amplitude=Amplitude("friction_per_way", "{f}/{x}", nonnegative=True),
        shapes=(replace(CENTRE, points=5), SMOOTHING),
        step=smoothed_sign_beside_rest,
        sentence="Dry friction of {friction_per_way}, growing on both sides of {centre}.",
    ),
    _BY_DIRECTION,
    replace(
        _BY_DIRECTION,
        law="presliding, by direction",
        shapes=(PRESLIDING, _BACKWARD),
        step=_presliding_by_direction,
        state_size=1,
    ),
    replace(
        _BY_DIRECTION,
        law="behind a spring, by direction",
        shapes=(PRESLIDING, _BACKWARD),
        step=_sliding_behind_spring_by_direction,
        state_size=1,
        extends="behind a spring",
    ),
    _UNDER_LOAD,
    replace(
        _UNDER_LOAD,
        law=f"presliding, {UNDER_LOAD}",
        shapes=(PRESLIDING, _DOUBLING),
        step=_presliding_under_load,
        state_size=1,
        extends="presliding",
    ),
)
