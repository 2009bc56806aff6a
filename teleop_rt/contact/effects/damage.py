"""Materials that remember how deep they were pressed: lost stiffness, and a set that stays."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import exp, expm1, tanh

from teleop_rt.contact.effect import (
    OF_THE_SPRING,
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    Vector,
)
from teleop_rt.contact.effects.stiffening import CENTRE, SPRING_POWER
from teleop_rt.contact.law import spring_force, touches
from teleop_rt.kernels.jit import kernel


@kernel
def _below_deepest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Lose stiffness with the energy below the past maximum, as Ogden and Roxburgh have it.

    Their error function is a hyperbolic tangent here; eta: its width as a share of the largest
    energy, and a depth whose energy adds to that.
    """
    depth = max(x, 0.0)
    state[0] = max(state[0], depth)
    most = state[0] * state[0]
    if most <= 0.0:
        return 0.0
    return -depth * tanh((most - depth * depth) / (eta[0] * (most + eta[1] * eta[1])))


@kernel
def _behind_deepest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Lose stiffness with the distance from the past maximum.

    eta: the distance of most of the loss, and how deep it was pressed before the recording.
    """
    depth = max(x, 0.0)
    state[0] = max(state[0], depth, eta[1])
    return -depth * (1.0 - exp((depth - state[0]) / eta[0]))


@kernel
def _behind_furthest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """As `_behind_deepest`, of a body that is held, on both sides of its rest at eta[0]."""
    beside = x - eta[0]
    state[0] = max(state[0], abs(beside))
    return float(-beside * (1.0 - exp((abs(beside) - state[0]) / eta[1])))


@kernel
def _spring_below_deepest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """As `_below_deepest`, by the energy of a spring of the power eta[2]."""
    depth, rise = max(x, 0.0), eta[2] + 1.0
    state[0] = max(state[0], depth)
    most = state[0] ** rise
    if most <= 0.0:
        return 0.0
    loss = tanh((most - depth**rise) / (eta[0] * (most + eta[1] ** rise)))
    return float(-spring_force(depth, 1.0, eta[2]) * loss)


@kernel
def _spring_behind_deepest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """As `_behind_deepest`, of a spring of the power eta[2]."""
    depth = max(x, 0.0)
    state[0] = max(state[0], depth, eta[1])
    return -spring_force(depth, 1.0, eta[2]) * (1.0 - exp((depth - state[0]) / eta[0]))


@kernel
def _set_behind_deepest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Leave a share of the deepest penetration behind as a lower surface."""
    state[0] = max(state[0], x)
    return float(-max(state[0], 0.0))


@kernel
def _set_creeping_in(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Lower the surface towards a share of the penetration beyond a yield depth; never back.

    Bingham and Perzyna's viscoplastic rate with linear hardening: the overstress is the excess of a
    spring's force over a threshold that grows with the set.
    """
    state[0] += max(x - eta[1] - state[0], 0.0) * -expm1(-dt / eta[0])
    return -float(state[0])


@kernel
def _set_beyond_yield(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Leave a share of the deepest penetration beyond a yield depth."""
    state[0] = max(state[0], x - eta[0])
    return float(-max(state[0], 0.0))


@kernel
def _set_during_unloading(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Lower the surface to a share of the deepest penetration once the tool has left it."""
    state[0] = max(state[0], x)
    if not touches(x):
        state[1] = max(state[0], 0.0)
    return float(-state[1])


_ENERGY = (
    Shape("width", "1", 0.02, 5.0, 0.5, logarithmic=True, points=4),
    Shape(
        "depth",
        "{x}",
        0.01,
        2.0,
        0.3,
        logarithmic=True,
        relative_to="travel",
        points=2,
        # Far deeper than the travel, its energy alone is the scale: Ogden and Roxburgh, beta = 0.
        ideal="upper",
    ),
)
_DISTANCE = (
    Shape("length", "{x}", 0.03, 3.0, 0.3, logarithmic=True, relative_to="travel", points=5),
    Shape("pressed_before", "{x}", 0.0, 0.9, 0.0, relative_to="travel", points=3),
)
_damaged = partial(
    Effect, family="hysteresis", belongs_to="environment", stage="material", compensation="render"
)

EFFECTS = (
    _damaged(
        name="mullins_softening",
        law="by energy",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}", nonnegative=True),
        shapes=_ENERGY,
        step=_below_deepest,
        sentence="Below the deepest past penetration {stiffness_lost} are lost.",
        state_size=1,
    ),
    _damaged(
        name="mullins_softening",
        law="by distance",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}", nonnegative=True),
        shapes=_DISTANCE,
        step=_behind_deepest,
        sentence="Up to {length} below the deepest past penetration {stiffness_lost} are lost.",
        state_size=1,
    ),
    _damaged(
        name="mullins_softening",
        law=f"{WITHOUT_CONTACT}, by distance",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}", nonnegative=True),
        shapes=(replace(CENTRE, points=5), _DISTANCE[0]),
        step=_behind_furthest,
        sentence=(
            "Up to {length} short of the furthest past place from {centre}, {stiffness_lost} are"
            " lost."
        ),
        state_size=1,
        only_in_contact=False,
    ),
    _damaged(
        name="mullins_softening",
        law=f"by energy {OF_THE_SPRING}",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}^power", nonnegative=True),
        shapes=(*_ENERGY, SPRING_POWER),
        step=_spring_below_deepest,
        sentence="Below the deepest past penetration {stiffness_lost} are lost.",
        state_size=1,
    ),
    _damaged(
        name="mullins_softening",
        law=f"by distance {OF_THE_SPRING}",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}^power", nonnegative=True),
        shapes=(*_DISTANCE, SPRING_POWER),
        step=_spring_behind_deepest,
        sentence="Up to {length} below the deepest past penetration {stiffness_lost} are lost.",
        state_size=1,
    ),
    _damaged(
        name="permanent_set",
        law="growing with the deepest penetration",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=0.7, points=6),
        step=_set_behind_deepest,
        sentence="A share of {share} of the penetration stays.",
        state_size=1,
        only_in_contact=False,
        acts="moves_position",
    ),
    _damaged(
        name="permanent_set",
        law="beyond a yield depth",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=0.7, points=4),
        shapes=(Shape("yield_depth", "{x}", 0.02, 0.7, 0.1, relative_to="travel", points=3),),
        step=_set_beyond_yield,
        sentence="A share of {share} of the penetration beyond {yield_depth} stays.",
        state_size=1,
        only_in_contact=False,
        acts="moves_position",
    ),
    _damaged(
        name="permanent_set",
        law="creeping in",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=1.0, points=6),
        shapes=(
            Shape(
                "creep_time",
                "s",
                3e-3,
                2.0,
                0.1,
                logarithmic=True,
                relative_to="duration",
                points=3,
                ideal="lower",
            ),
            Shape(
                "yield_depth",
                "{x}",
                0.0,
                0.7,
                0.0,
                relative_to="travel",
                points=2,
                ideal="lower",
            ),
        ),
        step=_set_creeping_in,
        sentence=(
            "A share of {share} of the penetration beyond {yield_depth} stays; it creeps in within"
            " {creep_time}."
        ),
        state_size=1,
        only_in_contact=False,
        acts="moves_position",
    ),
    _damaged(
        name="permanent_set",
        law="after each contact",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=0.7, points=6),
        step=_set_during_unloading,
        sentence="A share of {share} of the penetration stays.",
        state_size=2,
        only_in_contact=False,
        acts="moves_position",
    ),
)
