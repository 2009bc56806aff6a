"""Materials that relax: Maxwell arms, one or three, and a springpot.

Each also as a quasi-linear material (Fung 1981, ch. 7): its arms are stretched by the elastic
force, a power of the depth, rather than by the depth. Those of the spring follow the elastic force
of a rounded tip (Lee and Radok 1960).
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from math import exp

from teleop_rt.contact.effect import (
    OF_THE_SPRING,
    WITHOUT_CONTACT,
    Amplitude,
    Effect,
    Shape,
    Vector,
)
from teleop_rt.contact.effects.stiffening import SPRING_POWER
from teleop_rt.kernels.jit import kernel


@kernel
def _maxwell_arm(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance a spring and a dashpot in series; state: spring's stretch, last penetration, flag."""
    depth = max(x, 0.0)
    if state[2] == 0.0:
        state[2] = 1.0
        state[1] = depth
        state[0] = depth
    decay = exp(-dt / eta[0])
    gain = eta[0] / dt * (1.0 - decay)
    state[0] = decay * state[0] + gain * (depth - state[1])
    state[1] = depth
    return float(state[0])


@kernel
def _held_arm(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance the arm of a body that is held all along, at rest until the recording begins."""
    if state[2] == 0.0:
        state[2] = 1.0
        state[1] = x
    decay = exp(-dt / eta[0])
    state[0] = decay * state[0] + eta[0] / dt * (1.0 - decay) * (x - state[1])
    state[1] = x
    return float(state[0])


@kernel
def _arm_weights(
    state: Vector, dt: float, tau: float, ratio: float, weight: float, growth: float, count: int
) -> None:
    """Write decay and gain of `count` arms, tau apart by `ratio`, behind their stretches.

    They are kept, since a step may be called a million times with the same dt; state[0] is that
    dt, then come the stretches, the decays and the gains.
    """
    state[0] = dt
    for i in range(count):
        decay = exp(-dt / tau)
        state[1 + count + i] = decay
        state[1 + 2 * count + i] = weight * tau / dt * (1.0 - decay)
        tau *= ratio
        weight *= growth


@kernel
def _arms(state: Vector, change: float, count: int) -> float:
    """Advance the arms by a change of depth; returns the sum of their forces."""
    total = 0.0
    for i in range(count):
        moved = state[1 + count + i] * state[1 + i] + state[1 + 2 * count + i] * change
        state[1 + i] = moved
        total += moved
    return total


@kernel
def _three_arms(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance three Maxwell arms, a factor apart in time constant and another in stiffness."""
    depth = max(x, 0.0)
    if state[0] != dt:
        fastest = 1.0 / (1.0 + eta[2] + eta[2] * eta[2])
        _arm_weights(state, dt, eta[0] / eta[1], eta[1], fastest, eta[2], 3)
        if state[11] == 0.0:
            state[11] = 1.0
            state[10] = depth
            for i in range(3):
                state[1 + i] = depth * fastest * eta[2] ** i
    total = _arms(state, depth - state[10], 3)
    state[10] = depth
    return total


@kernel
def _springpot(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance the derivative of fractional order as a sum over log-spaced arms.

    1/t^q is the integral over ln tau of tau^-q exp(-t/tau) / Gamma(q); the factor is left to the
    amplitude.
    """
    depth = max(x, 0.0)
    if state[0] != dt:
        _arm_weights(state, dt, 2e-3, 2.5, 2e-3 ** (-eta[0]), 2.5 ** (-eta[0]), 14)
        if state[44] == 0.0:
            # As the other arms: pressed at the start, without a history.
            state[44] = 1.0
            state[43] = depth
            for i in range(14):
                state[1 + i] = depth * (2e-3 * 2.5**i) ** (-eta[0])
            # The arms slower than the slowest are springs for as long as anybody looks.
            slowest = 2e-3 * 2.5**14
            state[45] = slowest ** (-eta[0]) / (1.0 - 2.5 ** (-eta[0]))
    total = _arms(state, depth - state[43], 14)
    state[43] = depth
    return float(total + state[45] * depth)


@kernel
def _three_held_arms(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance three arms of a body that is held all along, at rest until the recording begins."""
    if state[0] != dt:
        fastest = 1.0 / (1.0 + eta[2] + eta[2] * eta[2])
        _arm_weights(state, dt, eta[0] / eta[1], eta[1], fastest, eta[2], 3)
        state[10] = x
    total = _arms(state, x - state[10], 3)
    state[10] = x
    return total


@kernel
def _held_springpot(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance the springpot of such a body; arms slower than its own are springs, as the base."""
    if state[0] != dt:
        _arm_weights(state, dt, 2e-3, 2.5, 2e-3 ** (-eta[0]), 2.5 ** (-eta[0]), 14)
        state[43] = x
    total = _arms(state, x - state[43], 14)
    state[43] = x
    return total


@kernel
def _maxwell_arm_on_power(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _maxwell_arm(state, max(x, 0.0) ** eta[1], v, a, t, dt, eta)


@kernel
def _three_arms_on_power(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _three_arms(state, max(x, 0.0) ** eta[3], v, a, t, dt, eta)


@kernel
def _springpot_on_power(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _springpot(state, max(x, 0.0) ** eta[1], v, a, t, dt, eta)


def _time_constant(points: int) -> Shape:
    """Return a time constant, from a few samples up to the longest that differs from a spring."""
    return Shape(
        "time_constant",
        "s",
        4e-4,
        2.0,
        0.03,
        logarithmic=True,
        relative_to="duration",
        points=points,
    )


# A tangent that falls with depth, as of stretched rubber; one that rises has a name of its own.
_POWER = Shape("power", "1", 0.2, 0.95, 0.6, points=3)

_SPREAD = Shape("spread", "1", 2.0, 30.0, 5.0, logarithmic=True, points=2)
_DECADES = replace(_SPREAD, upper=100.0, start=10.0, points=1)
_GROWTH = Shape("growth", "1", 0.1, 10.0, 1.0, logarithmic=True, points=1)
_ORDER = Shape("order", "1", 0.03, 0.95, 0.3, points=7)
_relaxing = partial(
    Effect,
    family="relaxation",
    belongs_to="environment",
    stage="material",
    compensation="render",
    derivative_order=1,
)

EFFECTS = (
    _relaxing(
        name="stress_relaxation",
        law="one arm",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_time_constant(12),),
        step=_maxwell_arm,
        sentence="A share of {arm_stiffness} relaxes within {time_constant}.",
        state_size=3,
        fades=1,
    ),
    _relaxing(
        name="stress_relaxation",
        law=WITHOUT_CONTACT,
        amplitude=Amplitude("arm_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_time_constant(12),),
        step=_held_arm,
        sentence="A share of {arm_stiffness} relaxes within {time_constant}.",
        state_size=3,
        only_in_contact=False,
        fades=1,
    ),
    _relaxing(
        name="stress_relaxation",
        law=f"{WITHOUT_CONTACT}, three arms",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_time_constant(8), _SPREAD, _GROWTH),
        step=_three_held_arms,
        sentence="A share of {arm_stiffness} relaxes around {time_constant}.",
        state_size=12,
        only_in_contact=False,
        fades=2,
        extends=WITHOUT_CONTACT,
    ),
    _relaxing(
        name="stress_relaxation",
        law="three arms",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_time_constant(8), _SPREAD, _GROWTH),
        step=_three_arms,
        sentence="A share of {arm_stiffness} relaxes around {time_constant}.",
        state_size=12,
        fades=2,
    ),
    _relaxing(
        name="stress_relaxation",
        law="one arm, quasi-linear",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(_time_constant(6), _POWER),
        step=_maxwell_arm_on_power,
        sentence="A share of {arm_stiffness} of the power {power} relaxes within {time_constant}.",
        state_size=3,
        fades=1,
    ),
    _relaxing(
        name="stress_relaxation",
        law=f"one arm {OF_THE_SPRING}",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(_time_constant(6), SPRING_POWER),
        step=_maxwell_arm_on_power,
        sentence="A share of {arm_stiffness} of the power {power} relaxes within {time_constant}.",
        state_size=3,
        fades=1,
    ),
    _relaxing(
        name="stress_relaxation",
        law="three arms, quasi-linear",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(_time_constant(5), _DECADES, _GROWTH, _POWER),
        step=_three_arms_on_power,
        sentence="A share of {arm_stiffness} of the power {power} relaxes around {time_constant}.",
        state_size=12,
        fades=2,
    ),
    _relaxing(
        name="stress_relaxation",
        law=f"three arms {OF_THE_SPRING}",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}^power", nonnegative=True),
        shapes=(_time_constant(5), _DECADES, _GROWTH, SPRING_POWER),
        step=_three_arms_on_power,
        sentence="A share of {arm_stiffness} of the power {power} relaxes around {time_constant}.",
        state_size=12,
        fades=2,
    ),
    _relaxing(
        name="fractional_relaxation",
        amplitude=Amplitude("springpot", "{f} s^order/{x}", nonnegative=True),
        shapes=(_ORDER,),
        step=_springpot,
        sentence="The force relaxes with a power of time, of order {order}.",
        state_size=46,
        fades=3,
    ),
    _relaxing(
        name="fractional_relaxation",
        law=WITHOUT_CONTACT,
        amplitude=Amplitude("springpot", "{f} s^order/{x}", nonnegative=True),
        shapes=(_ORDER,),
        step=_held_springpot,
        sentence="The force relaxes with a power of time, of order {order}.",
        state_size=46,
        only_in_contact=False,
        fades=3,
    ),
    _relaxing(
        name="fractional_relaxation",
        law="quasi-linear",
        amplitude=Amplitude("springpot", "{f} s^order/{x}^power", nonnegative=True),
        shapes=(replace(_ORDER, points=4), _POWER),
        step=_springpot_on_power,
        sentence="The force, of the power {power} of depth, relaxes with time, of order {order}.",
        state_size=46,
        fades=3,
    ),
    _relaxing(
        name="fractional_relaxation",
        law=OF_THE_SPRING,
        amplitude=Amplitude("springpot", "{f} s^order/{x}^power", nonnegative=True),
        shapes=(replace(_ORDER, points=4), SPRING_POWER),
        step=_springpot_on_power,
        sentence="The force, of the power {power} of depth, relaxes with time, of order {order}.",
        state_size=46,
        fades=3,
    ),
)
