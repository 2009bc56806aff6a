"""Softening: stiffness, alone or with damping, that falls with time or load."""

from __future__ import annotations

from dataclasses import replace
from math import exp

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


@kernel
def _worked(state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector) -> float:
    """Return the force lost by a structure that motion breaks and rest rebuilds.

    s' = (1 - s) |v| / eta[0] - s / eta[1] is the part of it that is broken (Moore 1959).
    """
    broken = abs(v) / eta[0] if touches(x) else 0.0
    rate = broken + 1.0 / eta[1]
    state[0] = broken / rate + (state[0] - broken / rate) * exp(-rate * dt)
    return float(-max(x, 0.0) * state[0])


@kernel
def _weakened_spring(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -spring_force(max(x, 0.0), 1.0, eta[1]) * (1.0 - exp(-t / eta[0]))


@kernel
def _spring_and_damper(x: float, v: float, damping_speed: float, power: float) -> float:
    """Return the force of a body of unit stiffness that doubles at the speed; it never pulls."""
    return max(spring_force(max(x, 0.0), 1.0, power) * (1.0 + v / damping_speed), 0.0)


@kernel
def _weakened_spring_alike(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return -_spring_and_damper(x, v, eta[1], eta[2]) * (1.0 - exp(-t / eta[0]))


@kernel
def _weakened_spring_by_load(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    state[0] += max(x, 0.0) * dt
    lost = eta[0] * (1.0 - exp(-state[0] / eta[0]))
    return float(-_spring_and_damper(x, v, eta[1], eta[2]) * lost)


# Damping over stiffness, which heat and damage lower alike.
_DAMPING_TIME = Shape("damping_time", "s", 1e-3, 0.2, 1e-2, logarithmic=True, points=4)
# The speed at which the damping of a body with a power is as large as its spring.
_DAMPING_SPEED = Shape(
    "damping_speed",
    "{x}/s",
    0.2,
    100.0,
    5.0,
    logarithmic=True,
    relative_to="speed",
    points=2,
    ideal="upper",
)
_LOAD_TIME = Shape(
    "load_time",
    "{x} s",
    0.3,
    100.0,
    5.0,
    logarithmic=True,
    relative_to="travel",
    points=8,
    ideal="upper",
)
LOSS_TIME = Shape(
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
    shapes=(replace(CENTRE, points=3), LOSS_TIME),
    step=_weakened_on_both_sides,
    sentence="Within {time_constant} the stiffness about {centre} falls by {stiffness_lost}.",
    turned="Within {time_constant} the stiffness about {centre} rises by {-stiffness_lost}.",
    compensation="render",
    only_in_contact=False,
)
EFFECTS = (
    Effect(
        name="softening",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}"),
        shapes=(LOSS_TIME,),
        step=_weakened,
        sentence="Within {time_constant} the stiffness falls by {stiffness_lost}.",
        turned="Within {time_constant} the stiffness rises by {-stiffness_lost}.",
        compensation="render",
    ),
    Effect(
        name="softening",
        law="of stiffness and damping",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}"),
        shapes=(LOSS_TIME, _DAMPING_TIME),
        step=_weakened_alike,
        sentence=(
            "Within {time_constant} the stiffness falls by {stiffness_lost}, the damping by"
            " {damping_time} times that."
        ),
        turned=(
            "Within {time_constant} the stiffness rises by {-stiffness_lost}, the damping by"
            " {damping_time} times that."
        ),
        compensation="render",
        derivative_order=1,
    ),
    Effect(
        name="softening",
        law="healing at rest",  # a gel, yoghurt, mud: thixotropy
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}", nonnegative=True),
        shapes=(
            Shape(
                "worked_way",
                "{x}",
                0.2,
                100.0,
                3.0,
                logarithmic=True,
                relative_to="travel",
                points=4,
            ),
            Shape(
                "healing_time",
                "s",
                0.01,
                3.0,
                0.1,
                logarithmic=True,
                relative_to="duration",
                points=4,
                ideal="upper",
            ),
        ),
        step=_worked,
        state_size=1,
        sentence=(
            "A way of {worked_way} in the body breaks {stiffness_lost} of its stiffness, and rest"
            " heals that within {healing_time}."
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
        turned=(
            "Within {time_constant} the stiffness about {centre} rises by {-stiffness_lost}, the"
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
        shapes=(_LOAD_TIME, _DAMPING_TIME),
        step=_weakened_by_load,
        state_size=1,
        sentence=(
            "Load takes {loss_rate} off the stiffness at first, and less once depth times time"
            " reaches {load_time}; the damping falls by {damping_time} times as much."
        ),
        turned=(
            "Load adds {-loss_rate} to the stiffness at first, and less once depth times time"
            " reaches {load_time}; the damping rises by {damping_time} times as much."
        ),
        compensation="render",
        derivative_order=1,
    ),
    Effect(
        name="softening",
        law=OF_THE_SPRING,
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}^power"),
        shapes=(LOSS_TIME, SPRING_POWER),
        step=_weakened_spring,
        sentence="Within {time_constant} the stiffness falls by {stiffness_lost}.",
        turned="Within {time_constant} the stiffness rises by {-stiffness_lost}.",
        compensation="render",
    ),
    Effect(
        name="softening",
        law=f"of stiffness and damping {OF_THE_SPRING}",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}^power"),
        shapes=(LOSS_TIME, _DAMPING_SPEED, SPRING_POWER),
        step=_weakened_spring_alike,
        sentence=(
            "Within {time_constant} the stiffness falls by {stiffness_lost}, and the damping, which"
            " equals the spring at {damping_speed}, with it."
        ),
        turned=(
            "Within {time_constant} the stiffness rises by {-stiffness_lost}, and the damping,"
            " which equals the spring at {damping_speed}, with it."
        ),
        compensation="render",
        derivative_order=1,
    ),
    Effect(
        name="softening",
        law=f"of stiffness and damping by load {OF_THE_SPRING}",
        family="drift",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("loss_rate", "{f}/({x}^(power+1) s)"),
        shapes=(_LOAD_TIME, _DAMPING_SPEED, SPRING_POWER),
        step=_weakened_spring_by_load,
        state_size=1,
        sentence=(
            "Load takes {loss_rate} off the stiffness at first, and less once depth times time"
            " reaches {load_time}; it also takes off damping, which equals the spring at"
            " {damping_speed}."
        ),
        turned=(
            "Load adds {-loss_rate} to the stiffness at first, and less once depth times time"
            " reaches {load_time}; it also adds damping, which equals the spring at"
            " {damping_speed}."
        ),
        compensation="render",
        derivative_order=1,
    ),
)
