"""Dry friction of the guide that falls as the tool speeds up (Stribeck)."""

from __future__ import annotations

from dataclasses import replace
from math import exp, tanh

from teleop_rt.contact.effect import Shape, Vector
from teleop_rt.contact.effects.friction import BRISTLE_TIME, DRY, PRESLIDING, SMOOTHING
from teleop_rt.kernels.jit import kernel


@kernel
def _stribeck_smoothed(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(tanh(v / eta[2]) * (1.0 + eta[1] * exp(-((v / eta[0]) ** 2))))


@kernel
def _stribeck_of_any_fall(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return float(tanh(v / eta[2]) * (1.0 + eta[1] * exp(-((abs(v) / eta[0]) ** eta[3]))))


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
def _stribeck_damped_presliding(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return z + tau z' of LuGre's model (Canudas de Wit et al., IEEE TAC 40, 1995)."""
    before = state[0]
    bent = _stribeck_presliding(state, x, v, a, t, dt, eta)
    return float(bent + eta[3] * (bent - before) / dt)


# Friction that gives way over more is not seen to fall with speed.
_SHORT_PRESLIDING = replace(PRESLIDING, upper=0.03, points=5)
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
# Of Gauss 2, of Tustin 1; a slower one is that of Hess and Soom.
_FALL = Shape("fall", "1", 0.4, 2.5, 1.5, points=1)

_STRIBECK_FRICTION = replace(
    DRY,
    name="stribeck_friction",
    shapes=(*_STRIBECK, SMOOTHING),
    step=_stribeck_smoothed,
    sentence="Dry friction of {friction_force} that rises by {excess_ratio} at low speed.",
)
EFFECTS = (
    _STRIBECK_FRICTION,
    replace(
        _STRIBECK_FRICTION,
        law="smoothed sign, of any fall",
        shapes=(*_STRIBECK, SMOOTHING, _FALL),
        step=_stribeck_of_any_fall,
        extends="smoothed sign",
    ),
    replace(
        _STRIBECK_FRICTION,
        law="presliding",
        shapes=(*_STRIBECK, _SHORT_PRESLIDING),
        step=_stribeck_presliding,
        state_size=1,
    ),
    replace(
        _STRIBECK_FRICTION,
        law="presliding, damped",
        shapes=(*_STRIBECK, _SHORT_PRESLIDING, BRISTLE_TIME),
        step=_stribeck_damped_presliding,
        state_size=1,
        extends="presliding",
    ),
)
