"""Material effects that remember: relaxation, hysteresis, damage."""

from __future__ import annotations

from math import exp, tanh

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


@kernel
def _bouc_wen(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Advance z' = v/d (1 - |z|^n (1 + sgn(v z))/2), Bouc-Wen with beta = gamma = 1/2."""
    if x > 0.0:
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
def _bouc_wen_with_depth(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    return _bouc_wen(state, x, v, a, t, dt, eta) * max(x, 0.0)


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
def _set_behind_deepest(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Leave a share of the deepest penetration behind as a lower surface."""
    state[0] = max(state[0], x)
    return float(-max(state[0], 0.0))


@kernel
def _set_beyond_yield(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Leave a share of what the deepest penetration has gone beyond a yield depth."""
    state[0] = max(state[0], x - eta[0])
    return float(-max(state[0], 0.0))


@kernel
def _set_during_unloading(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Lower the surface to a share of the deepest penetration once the tool has left it."""
    state[0] = max(state[0], x)
    if x <= 0.0:
        state[1] = max(state[0], 0.0)
    return float(-state[1])


def _time_constant(points: int) -> Shape:
    return Shape("time_constant", "s", 4e-3, 20.0, 0.3, logarithmic=True, points=points)


_YIELD = Shape(
    "yield_travel", "{x}", 3e-3, 0.6, 0.05, logarithmic=True, relative_to="travel", points=8
)
_SHARPNESS = Shape("sharpness", "1", 0.6, 5.0, 1.0, logarithmic=True, points=2)

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
    Effect(
        name="hysteresis",
        law="plain",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("yield_force", "{f}", nonnegative=True),
        shapes=(_YIELD, _SHARPNESS),
        step=_bouc_wen,
        sentence="A hysteretic force of {yield_force} turns over within {yield_travel}.",
        compensation="render",
        state_size=1,
        derivative_order=1,
    ),
    Effect(
        name="hysteresis",
        law="growing with depth",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("yield_stiffness", "{f}/{x}", nonnegative=True),
        shapes=(_YIELD, _SHARPNESS),
        step=_bouc_wen_with_depth,
        sentence="A hysteretic force of {yield_stiffness} turns over within {yield_travel}.",
        compensation="render",
        state_size=1,
        derivative_order=1,
    ),
    Effect(
        name="mullins_softening",
        law="by energy",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}", nonnegative=True),
        shapes=(
            Shape("width", "1", 0.02, 5.0, 0.5, logarithmic=True, points=4),
            Shape("depth", "{x}", 0.01, 2.0, 0.3, logarithmic=True, relative_to="travel", points=2),
        ),
        step=_below_deepest,
        sentence="Below the deepest past penetration {stiffness_lost} are lost.",
        compensation="render",
        state_size=1,
    ),
    Effect(
        name="mullins_softening",
        law="by distance",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("stiffness_lost", "{f}/{x}", nonnegative=True),
        shapes=(
            Shape(
                "length", "{x}", 0.03, 3.0, 0.3, logarithmic=True, relative_to="travel", points=5
            ),
            Shape("pressed_before", "{x}", 0.0, 1.2, 0.0, relative_to="travel", points=3),
        ),
        step=_behind_deepest,
        sentence="Up to {length} below the deepest past penetration {stiffness_lost} are lost.",
        compensation="render",
        state_size=1,
    ),
    Effect(
        name="permanent_set",
        law="growing with the deepest penetration",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=0.7, points=6),
        step=_set_behind_deepest,
        sentence="A share of {share} of the penetration stays.",
        compensation="render",
        state_size=1,
        only_in_contact=False,
        acts="moves_position",
    ),
    Effect(
        name="permanent_set",
        law="beyond a yield depth",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=0.7, points=4),
        shapes=(Shape("yield_depth", "{x}", 0.02, 0.7, 0.1, relative_to="travel", points=3),),
        step=_set_beyond_yield,
        sentence="A share of {share} of the penetration beyond {yield_depth} stays.",
        compensation="render",
        state_size=1,
        only_in_contact=False,
        acts="moves_position",
    ),
    Effect(
        name="permanent_set",
        law="after each contact",
        family="hysteresis",
        belongs_to="environment",
        stage="material",
        amplitude=Amplitude("share", "1", nonnegative=True, lower=3e-3, upper=0.7, points=6),
        step=_set_during_unloading,
        sentence="A share of {share} of the penetration stays.",
        compensation="render",
        state_size=2,
        only_in_contact=False,
        acts="moves_position",
    ),
)
