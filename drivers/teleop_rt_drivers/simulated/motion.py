"""The plant's motion: a position servo pressing on a viscoelastic body, by Runge-Kutta steps.

The steps are far shorter than a cycle of any bus. Nothing here is shared with the models that are
estimated from it. `hidden_motion.py` has the same motion with effects that a trial hides.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.kernels.jit import kernel, shared

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Vector = NDArray[np.float64]
    Stamps = NDArray[np.int64]

STEP_NS = 50_000
"""Longest internal step: 20 kHz."""
HISTORY = 4096
"""Internal steps kept for the lagged force: more than 20 ms at any SYNC rate up to 4 kHz."""

POSITION, VELOCITY, FORCE, IMPULSE, REFERENCE, REFERENCE_RATE, SEGMENT_LEFT = range(7)
STATES = SEGMENT_LEFT + 1
(
    MASS, SERVO_STIFFNESS, SERVO_DAMPING, SERVO_LIMIT, IDLE_DAMPING, STIFFNESS, DAMPING, SURFACE,
    PUSH, DECELERATION,
) = range(10)  # fmt: skip
CONSTANTS = DECELERATION + 1
OFF, FOLLOWING, STOPPING, PUSHING = 0, 1, 2, 3
"""States of the drive: it does nothing, follows the reference, brakes to rest, or pushes."""


@kernel
def contact_force(position: float, velocity: float, constants: Vector) -> float:
    """Return the force of the body on the tool, > 0 when pressed."""
    penetration = position - constants[SURFACE]
    if penetration < 0.0:
        return 0.0
    return max(0.0, float(constants[STIFFNESS] * penetration + constants[DAMPING] * velocity))


@kernel
def servo_force(
    position: float, velocity: float, reference: float, rate: float, mode: int, constants: Vector
) -> float:
    """Return the force of the drive on the tool."""
    if mode == OFF:
        return float(-constants[IDLE_DAMPING] * velocity)
    force = float(constants[PUSH])
    if mode != PUSHING:
        force = float(constants[SERVO_STIFFNESS] * (reference - position))
        force += float(constants[SERVO_DAMPING] * (rate - velocity))
    limit = float(constants[SERVO_LIMIT])
    return min(max(force, -limit), limit)


@kernel
def acceleration(position: float, velocity: float, servo: float, constants: Vector) -> float:
    """Return the acceleration of the tool under the drive's force `servo`."""
    force = servo - contact_force(position, velocity, constants)
    return force / float(constants[MASS])


@kernel
def advance_reference(state: Vector, mode: int, deceleration: float, step: float) -> None:
    """Advance the drive's reference by `step` [s].

    It runs along the segment to the last command, or it slows down to a stop.
    """
    if mode == FOLLOWING:
        moving = min(step, state[SEGMENT_LEFT])
        state[REFERENCE] += state[REFERENCE_RATE] * moving
        state[SEGMENT_LEFT] -= moving
        if state[SEGMENT_LEFT] <= 1e-9:
            state[SEGMENT_LEFT] = 0.0
            state[REFERENCE_RATE] = 0.0
    elif mode == STOPPING:
        rate = state[REFERENCE_RATE]
        slower = math.copysign(max(0.0, abs(rate) - deceleration * step), rate)
        state[REFERENCE] += 0.5 * (rate + slower) * step
        state[REFERENCE_RATE] = slower
    else:
        state[REFERENCE] = state[POSITION]
        state[REFERENCE_RATE] = 0.0


@shared
def follow(state: Vector, target: float, period_s: float) -> None:
    """Run the reference in a straight line to `target`, to be there after `period_s`."""
    state[REFERENCE_RATE] = (target - state[REFERENCE]) / period_s
    state[SEGMENT_LEFT] = period_s


@kernel
def advance(
    state: Vector,
    constants: Vector,
    stamps: Stamps,
    forces: Vector,
    mode: int,
    deceleration: float,
    head: int,
    start_ns: int,
    span_ns: int,
) -> int:
    """Integrate over `span_ns` by Runge-Kutta steps of at most 50 us; return the history's head.

    The reference is taken as linear within a step. Every step leaves its time and contact force
    in the history, a ring. The drive's force is integrated by the same steps as the velocity, so
    that its impulse [rig unit s] is the momentum and the impulse of the body.
    """
    steps = (span_ns + STEP_NS - 1) // STEP_NS
    h = span_ns * 1e-9 / steps
    for index in range(steps):
        r, w = state[REFERENCE], state[REFERENCE_RATE]
        advance_reference(state, mode, deceleration, h)
        r2 = state[REFERENCE]
        rm = 0.5 * (r + r2)
        x, v = state[POSITION], state[VELOCITY]
        s1 = servo_force(x, v, r, w, mode, constants)
        a1 = acceleration(x, v, s1, constants)
        x2, v2 = x + 0.5 * h * v, v + 0.5 * h * a1
        s2 = servo_force(x2, v2, rm, w, mode, constants)
        a2 = acceleration(x2, v2, s2, constants)
        x3, v3 = x + 0.5 * h * v2, v + 0.5 * h * a2
        s3 = servo_force(x3, v3, rm, w, mode, constants)
        a3 = acceleration(x3, v3, s3, constants)
        x4, v4 = x + h * v3, v + h * a3
        s4 = servo_force(x4, v4, r2, w, mode, constants)
        a4 = acceleration(x4, v4, s4, constants)
        state[IMPULSE] += h * (s1 + 2.0 * s2 + 2.0 * s3 + s4) / 6.0
        state[POSITION] = x + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
        state[VELOCITY] = v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        state[FORCE] = contact_force(state[POSITION], state[VELOCITY], constants)
        head = (head + 1) % HISTORY
        stamps[head] = start_ns + span_ns * (index + 1) // steps
        forces[head] = state[FORCE]
    return head


@kernel
def force_at(stamps: Stamps, forces: Vector, head: int, stamp_ns: int) -> float:
    """Return the contact force at an earlier time, linear between internal steps."""
    newer = head
    for back in range(1, HISTORY):
        older = (head - back) % HISTORY
        if stamps[older] <= stamp_ns:
            span = stamps[newer] - stamps[older]
            if span <= 0:
                return float(forces[newer])
            share = min(1.0, (stamp_ns - stamps[older]) / span)
            return float(forces[older] + share * (forces[newer] - forces[older]))
        newer = older
    return float(forces[newer])
