"""The plant: a position servo pressing on a viscoelastic body, integrated far above the bus rate.

Its physics are its own: nothing here is shared with the models that are estimated from it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_rt.jit import kernel

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from teleop_rt_drivers.simulated.config import SimulatedPlantConfig

    Vector = NDArray[np.float64]
    Stamps = NDArray[np.int64]

STEP_NS = 50_000
"""Longest internal step: 20 kHz."""
HISTORY = 4096
"""Internal steps kept for the lagged force: more than 20 ms at any SYNC rate up to 4 kHz."""

POSITION, VELOCITY, FORCE, SERVO_FORCE, REFERENCE, REFERENCE_RATE, SEGMENT_LEFT = range(7)
STATES = 7
(MASS, SERVO_STIFFNESS, SERVO_DAMPING, SERVO_LIMIT, IDLE_DAMPING, STIFFNESS, DAMPING, SURFACE) = (
    range(8)
)
OFF, FOLLOWING, STOPPING = 0, 1, 2


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
    force = float(constants[SERVO_STIFFNESS] * (reference - position))
    force += float(constants[SERVO_DAMPING] * (rate - velocity))
    limit = float(constants[SERVO_LIMIT])
    return min(max(force, -limit), limit)


@kernel
def acceleration(
    position: float, velocity: float, reference: float, rate: float, mode: int, constants: Vector
) -> float:
    """Return the acceleration of the tool; hidden effects are further terms of this sum."""
    force = servo_force(position, velocity, reference, rate, mode, constants)
    force -= contact_force(position, velocity, constants)
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


@kernel
def advance(
    state: Vector,
    constants: Vector,
    mode: int,
    deceleration: float,
    stamps: Stamps,
    forces: Vector,
    head: int,
    start_ns: int,
    span_ns: int,
) -> int:
    """Integrate over `span_ns` by Runge-Kutta steps of at most 50 us; return the history's head.

    The reference is taken as linear within a step. Every step leaves its time and contact force
    in the history, a ring.
    """
    steps = (span_ns + STEP_NS - 1) // STEP_NS
    h = span_ns * 1e-9 / steps
    for index in range(steps):
        r, w = state[REFERENCE], state[REFERENCE_RATE]
        advance_reference(state, mode, deceleration, h)
        r2 = state[REFERENCE]
        rm = 0.5 * (r + r2)
        x, v = state[POSITION], state[VELOCITY]
        a1 = acceleration(x, v, r, w, mode, constants)
        v2 = v + 0.5 * h * a1
        a2 = acceleration(x + 0.5 * h * v, v2, rm, w, mode, constants)
        v3 = v + 0.5 * h * a2
        a3 = acceleration(x + 0.5 * h * v2, v3, rm, w, mode, constants)
        v4 = v + h * a3
        a4 = acceleration(x + h * v3, v4, r2, w, mode, constants)
        state[POSITION] = x + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0
        state[VELOCITY] = v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0
        state[FORCE] = contact_force(state[POSITION], state[VELOCITY], constants)
        head = (head + 1) % HISTORY
        stamps[head] = start_ns + span_ns * (index + 1) // steps
        forces[head] = state[FORCE]
    state[SERVO_FORCE] = servo_force(
        state[POSITION],
        state[VELOCITY],
        state[REFERENCE],
        state[REFERENCE_RATE],
        mode,
        constants,
    )
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


class Plant:
    """Tool, drive and environment, and the sensors on them; all random numbers from one seed."""

    def __init__(self, config: SimulatedPlantConfig, start_ns: int, seed: int) -> None:
        self.config = config
        self.now_ns = start_ns
        self.mode = OFF
        self._start_ns = start_ns
        self._random = np.random.default_rng(seed)
        self._state = np.zeros(STATES)
        self._state[POSITION] = self._state[REFERENCE] = config.start
        self._constants = _constants(config)
        self._deceleration = 0.0
        self._state[FORCE] = contact_force(config.start, 0.0, self._constants)
        self._stamps = np.full(HISTORY, start_ns, dtype=np.int64)
        self._forces = np.full(HISTORY, self._state[FORCE])
        self._head = 0
        self._compile()

    def _compile(self) -> None:
        """Compile the kernels on a copy, so that the first SYNC is answered in time."""
        state, stamps, forces = self._state.copy(), self._stamps.copy(), self._forces.copy()
        advance(state, self._constants, OFF, 0.0, stamps, forces, 0, self.now_ns, STEP_NS)
        force_at(stamps, forces, 1, self.now_ns)

    @property
    def position(self) -> float:
        """True position of the tool."""
        return float(self._state[POSITION])

    @property
    def velocity(self) -> float:
        """True velocity of the tool."""
        return float(self._state[VELOCITY])

    @property
    def force(self) -> float:
        """True contact force."""
        return float(self._state[FORCE])

    @property
    def encoder_counts(self) -> float:
        """Position as the encoder counts it, not rounded."""
        sensors = self.config.sensors
        return (self.position - sensors.encoder_zero) / sensors.encoder_resolution

    @property
    def drive_counts(self) -> float:
        """Position as the drive counts it, not rounded."""
        return self.counts_of(self.position)

    @property
    def switch_closed(self) -> bool:
        """Tell whether the tool is on the home switch."""
        switch = self.config.sensors.home_switch
        return switch is not None and self.position <= switch

    def counts_of(self, position: float) -> float:
        """Return a true position in the drive's counts, not rounded."""
        return (position - self.config.drive.zero) / self.config.drive.position_resolution

    def position_of(self, counts: float) -> float:
        """Return the true position of the drive's counts."""
        return self.config.drive.zero + counts * self.config.drive.position_resolution

    @property
    def servo_force(self) -> float:
        """Force of the drive on the tool."""
        return float(self._state[SERVO_FORCE])

    @property
    def reference(self) -> float:
        """Position that the drive follows now."""
        return float(self._state[REFERENCE])

    def advance(self, to_ns: int) -> None:
        """Integrate up to `to_ns`; nothing happens when that is not in the future."""
        if to_ns > self.now_ns:
            self._head = advance(
                self._state,
                self._constants,
                self.mode,
                self._deceleration,
                self._stamps,
                self._forces,
                self._head,
                self.now_ns,
                to_ns - self.now_ns,
            )
            self.now_ns = to_ns

    def power_off(self) -> None:
        """Take the servo's force away."""
        self.mode = OFF

    def hold(self) -> None:
        """Put the servo under power where the tool is."""
        self.mode = FOLLOWING
        self._state[REFERENCE] = self._state[POSITION]
        self._state[REFERENCE_RATE] = self._state[SEGMENT_LEFT] = 0.0

    def follow(self, target: float, period_s: float) -> None:
        """Run the reference in a straight line to `target`, to be there after `period_s`."""
        self._state[REFERENCE_RATE] = (target - self._state[REFERENCE]) / period_s
        self._state[SEGMENT_LEFT] = period_s

    def slow_down(self, deceleration: float) -> None:
        """Bring the reference to rest under power, from the speed that the tool has now."""
        self.mode = STOPPING
        self._state[REFERENCE_RATE] = self._state[VELOCITY]
        self._deceleration = deceleration

    @property
    def at_rest(self) -> bool:
        """Tell whether the reference has come to rest."""
        return bool(self._state[REFERENCE_RATE] == 0.0)

    def measured_force(self) -> float:
        """Return what the force sensor gives now: the force of some time ago, and noise."""
        sensors = self.config.sensors
        jitter_us = self._random.uniform(-1.0, 1.0) * sensors.force_lag_jitter_us
        lag_ns = max(0, round(1e6 * sensors.force_lag_ms + 1e3 * jitter_us))
        lagged = force_at(self._stamps, self._forces, self._head, self.now_ns - lag_ns)
        age_s = (self.now_ns - self._start_ns) * 1e-9
        lagged += sensors.force_offset + sensors.force_drift * age_s
        return lagged + sensors.force_noise * self._random.standard_normal()

    def truth(self) -> dict[str, Any]:
        """Return all that only the plant knows, in the rig's units."""
        return {
            "environment": self.config.environment.model_dump(),
            "sensors": self.config.sensors.model_dump(),
            "drive": self.config.drive.model_dump(),
            "undeclared": list(self.config.undeclared),
        }


def _constants(config: SimulatedPlantConfig) -> Vector:
    """Return the constants of the kernel: servo gains from its bandwidth, the body's own."""
    drive, body = config.drive, config.environment
    natural = 2.0 * math.pi * drive.bandwidth_hz
    constants = np.zeros(8)
    constants[MASS] = drive.mass
    constants[SERVO_STIFFNESS] = drive.mass * natural**2
    constants[SERVO_DAMPING] = 2.0 * drive.damping_ratio * drive.mass * natural
    constants[SERVO_LIMIT] = drive.force_max
    constants[IDLE_DAMPING] = drive.idle_damping
    constants[STIFFNESS] = body.stiffness
    constants[DAMPING] = body.damping
    constants[SURFACE] = body.surface
    return constants
