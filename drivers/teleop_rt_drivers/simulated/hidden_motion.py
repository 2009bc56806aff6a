"""The plant's motion with a trial's hidden effects: one system of equations, Runge-Kutta steps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.kernels.jit import kernel
from teleop_rt_drivers.simulated import hidden, motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from teleop_rt_drivers.simulated.motion import Stamps, Vector

    Matrix = NDArray[np.float64]

X, V, MEMORIES = 0, 1, 2  # places in the state: position, velocity, the body's memories
N_ALL = MEMORIES + hidden.N_MEMORIES
STAGES = 6
"""Rows of scratch: the state, a trial state, and the four slopes."""


@kernel
def _servo(y: Vector, reference: float, rate: float, mode: int, constants: Vector) -> float:
    """Return the drive's force on the tool."""
    return float(motion.servo_force(y[X], y[V], reference, rate, mode, constants))


@kernel
def _slope(
    y: Vector, reference: float, rate: float, mode: int, t: float,
    constants: Vector, c: Vector, out: Vector,
) -> float:  # fmt: skip
    """Write the rates of tool and memories; return the force on the sensor."""
    memories, rates = y[MEMORIES:], out[MEMORIES:]
    x, v = y[X], y[V]
    tip, tip_rate = hidden.tip_motion(x, v, t, memories, c)
    contact = hidden.body_force(tip, tip_rate, t, memories, c)
    guide = hidden.guide_force(v, memories, c)
    servo = _servo(y, reference, rate, mode, constants)
    out[X] = v
    out[V] = (servo - contact - guide) / constants[motion.MASS]
    loaded = contact + guide + c[hidden.TOOL_MASS] * out[V]
    hidden.body_rates(tip, tip_rate, t, memories, c, rates)
    hidden.rig_rates(x, v, t, loaded, memories, c, rates)
    return float(loaded)


@kernel
def _along(y: Vector, slope: Vector, step: float, out: Vector) -> None:
    """Write y + step slope."""
    for i in range(y.size):
        out[i] = y[i] + step * slope[i]


@kernel
def _step(y: Vector, step: float, a1: Vector, a2: Vector, a3: Vector, a4: Vector) -> None:
    """Advance y by a Runge-Kutta step with these four slopes."""
    for i in range(y.size):
        y[i] += step * (a1[i] + 2.0 * a2[i] + 2.0 * a3[i] + a4[i]) / 6.0


@kernel
def advance_hidden(
    state: Vector, memories: Vector, constants: Vector, c: Vector, mode: int, deceleration: float,
    stamps: Stamps, forces: Vector, head: int, start_ns: int, span_ns: int, elapsed_ns: int,
    scratch: Matrix,
) -> int:  # fmt: skip
    """Integrate as `motion.advance` does, with the memories (N_MEMORIES,); return the head.

    `elapsed_ns` is the plant's age at the start of the span. The history gets the force the sensor
    gives. scratch (STAGES, N_ALL).
    """
    steps = (span_ns + motion.STEP_NS - 1) // motion.STEP_NS
    h = span_ns * 1e-9 / steps
    y, trial, a1, a2, a3, a4 = (
        scratch[0], scratch[1], scratch[2], scratch[3], scratch[4], scratch[5],
    )  # fmt: skip
    for index in range(steps):
        t = elapsed_ns * 1e-9 + h * index
        r, w = state[motion.REFERENCE], state[motion.REFERENCE_RATE]
        motion.advance_reference(state, mode, deceleration, h)
        r2 = state[motion.REFERENCE]
        rm = 0.5 * (r + r2)
        y[X], y[V] = state[motion.POSITION], state[motion.VELOCITY]
        for i in range(hidden.N_MEMORIES):
            y[MEMORIES + i] = memories[i]
        s1 = _servo(y, r, w, mode, constants)
        _slope(y, r, w, mode, t, constants, c, a1)
        _along(y, a1, 0.5 * h, trial)
        s2 = _servo(trial, rm, w, mode, constants)
        _slope(trial, rm, w, mode, t + 0.5 * h, constants, c, a2)
        _along(y, a2, 0.5 * h, trial)
        s3 = _servo(trial, rm, w, mode, constants)
        _slope(trial, rm, w, mode, t + 0.5 * h, constants, c, a3)
        _along(y, a3, h, trial)
        s4 = _servo(trial, r2, w, mode, constants)
        _slope(trial, r2, w, mode, t + h, constants, c, a4)
        state[motion.IMPULSE] += h * (s1 + 2.0 * s2 + 2.0 * s3 + s4) / 6.0
        _step(y, h, a1, a2, a3, a4)
        _settle(y, t + h, state, memories, c)
        loaded = _slope(y, r2, w, mode, t + h, constants, c, a1)
        head = (head + 1) % motion.HISTORY
        stamps[head] = start_ns + span_ns * (index + 1) // steps
        forces[head] = hidden.sensed_force(loaded, t + h, memories, c)
    return head


@kernel
def _settle(y: Vector, t: float, state: Vector, memories: Vector, c: Vector) -> None:
    """End a step: keep bristles below their most, note depth and force."""
    if c[hidden.KINETIC] > 0.0:
        most = max(c[hidden.STATIC], c[hidden.KINETIC]) / c[hidden.BRISTLE]
        place = MEMORIES + hidden.BRISTLES
        y[place] = min(max(y[place], -most), most)
    for i in range(hidden.N_MEMORIES):
        memories[i] = y[MEMORIES + i]
    state[motion.POSITION], state[motion.VELOCITY] = y[X], y[V]
    tip, tip_rate = hidden.tip_motion(y[X], y[V], t, memories, c)
    hidden.note_depth(tip, t, memories, c)
    state[motion.FORCE] = hidden.body_force(tip, tip_rate, t, memories, c)


def force_along(position: Vector, period_s: float, c: Vector, substeps: int) -> Vector:
    """Return the body's force (n,) for a tip led along positions (n,), straight in between.

    The body's memories are integrated from rest, by Runge-Kutta steps of period_s / substeps.
    """
    force = np.zeros(position.size)
    _lead(position, period_s, c, substeps, np.zeros((STAGES, hidden.N_MEMORIES)), force)
    return force


@kernel
def _lead(
    position: Vector, period_s: float, c: Vector, substeps: int, scratch: Matrix, out: Vector
) -> None:
    m, trial, a1, a2, a3, a4 = (
        scratch[0], scratch[1], scratch[2], scratch[3], scratch[4], scratch[5],
    )  # fmt: skip
    h = period_s / substeps
    for i in range(1, position.size):
        v = (position[i] - position[i - 1]) / period_s
        for k in range(substeps):
            t, x = (i - 1) * period_s + k * h, position[i - 1] + v * k * h
            hidden.body_rates(x, v, t, m, c, a1)
            _along(m, a1, 0.5 * h, trial)
            hidden.body_rates(x + 0.5 * h * v, v, t + 0.5 * h, trial, c, a2)
            _along(m, a2, 0.5 * h, trial)
            hidden.body_rates(x + 0.5 * h * v, v, t + 0.5 * h, trial, c, a3)
            _along(m, a3, h, trial)
            hidden.body_rates(x + h * v, v, t + h, trial, c, a4)
            _step(m, h, a1, a2, a3, a4)
            hidden.note_depth(x + h * v, t + h, m, c)
        out[i] = hidden.body_force(position[i], v, i * period_s, m, c)
