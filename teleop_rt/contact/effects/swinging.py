"""Masses that the tool drags along on springs of their own: they swing after it moves."""

from __future__ import annotations

from math import cos, exp, pi, sin, sqrt

from teleop_rt.contact.effect import Amplitude, Effect, Shape, Vector
from teleop_rt.kernels.jit import kernel


@kernel
def _swinging(
    state: Vector, x: float, v: float, a: float, t: float, dt: float, eta: Vector
) -> float:
    """Return the force per mass of a mass on a spring and damper that the tool holds.

    eta: natural frequency and damping ratio (below 1). The gap between mass and tool swings freely
    in each step, in which the tool's velocity is constant, and its rate changes with that velocity:
    exact for a position in straight lines. state: gap, its rate, last velocity, a start flag.
    """
    if state[3] == 0.0:
        state[3] = 1.0
        state[2] = v
    natural = 2.0 * pi * eta[0]
    decay, turn = natural * eta[1], natural * sqrt(1.0 - eta[1] * eta[1])
    faster = v - state[2]
    gap, rate = state[0], state[1] - faster
    state[2] = v
    fade, cosine, sine = exp(-decay * dt), cos(turn * dt), sin(turn * dt) / turn
    state[0] = fade * (gap * (cosine + decay * sine) + rate * sine)
    state[1] = fade * (rate * (cosine - decay * sine) - gap * natural * natural * sine)
    # At a sample the gap's rate is that midway between before and after the next such change.
    return float(-natural * natural * state[0] - 2.0 * decay * (state[1] - 0.5 * faster))


ON_ITS_SPRING = "on a spring of its own"
EFFECTS = (
    Effect(
        name="tool_inertia",
        law=ON_ITS_SPRING,
        family="inertia",
        belongs_to="rig",
        stage="tool",
        amplitude=Amplitude("swinging_mass", "{f} s^2/{x}", nonnegative=True),
        shapes=(
            Shape("frequency", "Hz", 1.0, 60.0, 8.0, logarithmic=True, points=20),
            Shape("damping_ratio", "1", 0.003, 0.7, 0.05, logarithmic=True, points=2),
        ),
        step=_swinging,
        sentence=(
            "A mass of {swinging_mass} swings on a spring of its own, at {frequency}, damped by"
            " {damping_ratio}."
        ),
        compensation="subtract_force",
        state_size=4,
        derivative_order=1,
        only_in_contact=False,
    ),
)
