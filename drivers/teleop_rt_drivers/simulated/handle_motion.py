"""Two bodies: an operator's device with its motor, and the hand that holds it through its flesh.

Nothing here is shared with the rendered walls or with the bound that they are held to.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.kernels.jit import kernel
from teleop_rt_drivers.simulated.motion import HISTORY

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.motion import Stamps, Vector

STEP_NS = 20_000
"""Longest internal step: 50 kHz, a hundredth of the period of the fastest resonance below."""
HISTORY_NS = 50_000
"""Between the positions that are kept for samples of some age: 0.2 s in all."""
FLESH_STIFFNESS, FLESH_DAMPING = 5.0e4, 60.0
"""Of the fingers around the handle [N/m], [N s/m]: far stiffer than any arm, which is in series."""
STOP_STIFFNESS, STOP_DAMPING = 1.0e5, 50.0
"""Of the end stops [N/m], [N s/m]: a metal block with a rubber face."""
DRY_SPEED = 1e-3
"""Speed [m/s] at which dry friction is fully there; it rises smoothly from rest."""

POSITION, VELOCITY, HAND, HAND_VELOCITY, MOTOR, PORT, GIVEN, LEAST, MOTOR_WORK = range(9)
"""`PORT` is the hand's force on the device, `GIVEN` the energy it gave, `LEAST` that at its least;
`MOTOR_WORK` is the energy that went into the motor."""
STATES = MOTOR_WORK + 1
(
    MASS, DAMPING, DRY, STOP_MIN, STOP_MAX, MOTOR_LAG_S, HAND_MASS, HAND_STIFFNESS, HAND_DAMPING,
    HAND_FORCE,
) = range(10)  # fmt: skip
"""`HAND_FORCE` is the largest of the hand's spring and damper together."""
CONSTANTS = HAND_FORCE + 1


@kernel
def passive_force(x: float, v: float, constants: Vector) -> float:
    """Return the force of friction and end stops on the device."""
    force = -constants[DAMPING] * v - constants[DRY] * math.tanh(v / DRY_SPEED)
    if x > constants[STOP_MAX]:
        force -= max(0.0, STOP_STIFFNESS * (x - constants[STOP_MAX]) + STOP_DAMPING * v)
    elif x < constants[STOP_MIN]:
        force -= min(0.0, STOP_STIFFNESS * (x - constants[STOP_MIN]) + STOP_DAMPING * v)
    return float(force)


@kernel
def advance_handle(
    state: Vector,
    constants: Vector,
    command: float,
    goal: float,
    rate: float,
    tremor: float,
    grip: float,
    span_s: float,
    steps: int,
) -> None:
    """Integrate over `span_s` (semi-implicit Euler), the motor following `command`.

    `goal` is where the hand wants to be at the start, at `rate`; `grip` scales its springs, and a
    hand without grip holds nothing.
    """
    h = span_s / steps
    follow = 1.0 - math.exp(-h / constants[MOTOR_LAG_S])
    for index in range(steps):
        x, v = state[POSITION], state[VELOCITY]
        y, w = state[HAND], state[HAND_VELOCITY]
        wanted = goal + rate * h * index
        held = FLESH_STIFFNESS * (y - x) + FLESH_DAMPING * (w - v) if grip > 0.0 else 0.0
        push = grip * (
            constants[HAND_STIFFNESS] * (wanted - y) + constants[HAND_DAMPING] * (rate - w)
        )
        push = min(max(push, -constants[HAND_FORCE]), constants[HAND_FORCE])
        state[MOTOR] += follow * (command - state[MOTOR])
        force = held + state[MOTOR] + passive_force(x, v, constants)
        state[VELOCITY] = v + h * force / constants[MASS]
        state[HAND_VELOCITY] = w + h * (push + tremor - held) / constants[HAND_MASS]
        moved = h * state[VELOCITY]
        state[POSITION] = x + moved
        state[HAND] = y + h * state[HAND_VELOCITY]
        state[PORT] = held
        state[GIVEN] += held * 0.5 * (moved + h * v)
        state[LEAST] = min(state[LEAST], state[GIVEN])
        state[MOTOR_WORK] -= state[MOTOR] * 0.5 * (moved + h * v)


@kernel
def move_handle(
    state: Vector,
    constants: Vector,
    stamps: Stamps,
    positions: Vector,
    head: int,
    from_ns: int,
    until_ns: int,
    command: float,
    goal: float,
    rate: float,
    tremor: float,
    grip: float,
    goal_ns: int,
) -> int:
    """Integrate up to `until_ns`, keep the positions of the way, and return the newest's place.

    `goal` is where the hand wants to be at `goal_ns`; all else is as for `advance_handle`.
    """
    now_ns = from_ns
    while now_ns < until_ns:
        next_ns = min(until_ns, now_ns + HISTORY_NS)
        span_ns = next_ns - now_ns
        begin = goal - rate * (goal_ns - now_ns) * 1e-9
        steps = -(-span_ns // STEP_NS)
        advance_handle(state, constants, command, begin, rate, tremor, grip, span_ns * 1e-9, steps)
        now_ns = next_ns
        head = (head + 1) % HISTORY
        stamps[head], positions[head] = now_ns, state[POSITION]
    return head
