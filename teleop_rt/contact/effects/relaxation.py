"""Materials that relax: Maxwell arms, one or three, and a springpot."""

from __future__ import annotations

from math import exp

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.jit import kernel


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


def _time_constant(points: int) -> Shape:
    return Shape("time_constant", "s", 4e-3, 20.0, 0.3, logarithmic=True, points=points)


EFFECTS = (
    Effect(
        name="stress_relaxation",
        law="one arm",
        family="relaxation",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_time_constant(12),),
        step=_maxwell_arm,
        sentence="A share of {arm_stiffness} relaxes within {time_constant}.",
        compensation="render",
        state_size=3,
        derivative_order=1,
        fades=1,
    ),
    Effect(
        name="stress_relaxation",
        law="three arms",
        family="relaxation",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("arm_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(
            _time_constant(8),
            Shape("spread", "1", 2.0, 30.0, 5.0, logarithmic=True, points=2),
            Shape("growth", "1", 0.1, 10.0, 1.0, logarithmic=True, points=1),
        ),
        step=_three_arms,
        sentence="A share of {arm_stiffness} relaxes around {time_constant}.",
        compensation="render",
        state_size=12,
        derivative_order=1,
        fades=2,
    ),
    Effect(
        name="fractional_relaxation",
        family="relaxation",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("springpot", "{f} s^order/{x}", nonnegative=True),
        shapes=(Shape("order", "1", 0.03, 0.95, 0.3, points=7),),
        step=_springpot,
        sentence="The force relaxes with a power of time, of order {order}.",
        compensation="render",
        state_size=46,
        derivative_order=1,
        fades=3,
    ),
)
