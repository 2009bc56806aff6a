"""The plant: tool, drive and environment, and the sensors on them.

Its physics are its own: nothing here is shared with the models that are estimated from it.
"""

from __future__ import annotations

import math
from collections import deque
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.simulated import hidden
from teleop_rt_drivers.simulated.hidden_motion import N_ALL, STAGES, advance_hidden
from teleop_rt_drivers.simulated.motion import (
    CONSTANTS,
    DAMPING,
    FOLLOWING,
    FORCE,
    HISTORY,
    IDLE_DAMPING,
    IMPULSE,
    MASS,
    OFF,
    POSITION,
    PUSH,
    PUSHING,
    REFERENCE,
    REFERENCE_RATE,
    SEGMENT_LEFT,
    SERVO_DAMPING,
    SERVO_LIMIT,
    SERVO_STIFFNESS,
    STATES,
    STEP_NS,
    STIFFNESS,
    STOPPING,
    SURFACE,
    VELOCITY,
    advance,
    contact_force,
    force_at,
)

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
    from teleop_rt_drivers.simulated.motion import Stamps, Vector


REPORTED_NS = 1_000_000
"""Over so long an industrial drive averages the torque that it reports."""
IMPULSES = 256
"""Times kept of the drive's impulse: more than 20 ms of the smallest steps of a bus."""


class Plant:
    """Tool, drive and environment, and the sensors on them; all random numbers from one seed."""

    def __init__(self, config: SimulatedPlantConfig, start_ns: int, seed: int) -> None:
        self.config = config
        self.now_ns = start_ns
        self.mode = OFF
        self.hung = 0.0
        """Force of a weight that hangs at the force sensor."""
        self._random = np.random.default_rng(seed)
        self._state = np.zeros(STATES)
        self._state[POSITION] = self._state[REFERENCE] = config.start
        self._constants = _constants(config)
        self._deceleration = 0.0
        self._state[FORCE] = contact_force(config.start, 0.0, self._constants)
        self._stamps = np.full(HISTORY, start_ns, dtype=np.int64)
        self._forces = np.full(HISTORY, self._state[FORCE])
        self._head = 0
        self._start_ns = start_ns
        self._hides = bool(config.undeclared or config.environment.hunt_crossley)
        self._hidden = hidden_constants(config)
        self._memories = np.zeros(hidden.N_MEMORIES)
        self._memories[hidden.TIP] = config.start
        self._scratch = np.zeros((STAGES, N_ALL))
        self._impulses: deque[tuple[int, float]] = deque(maxlen=IMPULSES)
        self._compile()

    def _compile(self) -> None:
        """Compile the kernels, one on a copy, so that the first SYNC is answered in time."""
        self._force_at = bound(force_at, (self._stamps, self._forces), 1, self.now_ns)
        if not self._hides:
            arrays = self._state, self._constants, self._stamps, self._forces
            numbers = self.mode, self._deceleration, 0, self.now_ns, STEP_NS
            self._advance = bound(advance, arrays, *numbers)
            return
        kept = [self._state, self._stamps, self._forces, self._memories]
        self._state, self._stamps, self._forces, self._memories = (array.copy() for array in kept)
        self._integrate(STEP_NS)
        self._state, self._stamps, self._forces, self._memories = kept
        self._head = 0

    @property
    def position(self) -> float:
        """True position of the tool."""
        return self._state.item(POSITION)

    @property
    def velocity(self) -> float:
        """True velocity of the tool."""
        return self._state.item(VELOCITY)

    def place(self, position: float, velocity: float) -> None:
        """Put the tool somewhere, as a hand or a jam does: no law of the plant asks for it."""
        self._state[POSITION], self._state[VELOCITY] = position, velocity

    @property
    def force(self) -> float:
        """True contact force."""
        return self._state.item(FORCE)

    def motion_row(self) -> list[float]:
        """Return the row of `teleop_rt.signals.TRUTH` of now."""
        read = self._state.item
        return [
            self.now_ns, read(POSITION), read(VELOCITY), read(FORCE), read(REFERENCE), self.mode,
        ]  # fmt: skip

    @property
    def encoder_counts(self) -> float:
        """Position as the encoder counts it, not rounded."""
        sensors = self.config.sensors
        return (self.position - sensors.encoder_zero) / sensors.encoder_resolution

    @property
    def reported_position(self) -> float:
        """Position that a drive with its own encoder reports now."""
        return self.position

    @property
    def drive_counts(self) -> float:
        """Position as the drive counts it, not rounded."""
        return self.counts_of(self.position)

    @property
    def switch_closed(self) -> bool:
        """Return whether the tool is on the home switch."""
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
        """Force of the drive on the tool, its mean over the last millisecond."""
        return self.mean_servo_force(REPORTED_NS)

    def mean_servo_force(self, span_ns: int) -> float:
        """Return the drive's mean force over this time, however often the plant was asked."""
        if not self._impulses:
            return 0.0
        (newest_ns, newest), begin_ns = self._impulses[-1], self._impulses[-1][0] - span_ns
        later_ns, later = newest_ns, newest
        for earlier_ns, earlier in reversed(self._impulses):
            if earlier_ns <= begin_ns:
                share = (begin_ns - earlier_ns) / max(1, later_ns - earlier_ns)
                return (newest - earlier - share * (later - earlier)) / (span_ns * 1e-9)
            later_ns, later = earlier_ns, earlier
        return (newest - later) / max(1e-9, (newest_ns - later_ns) * 1e-9)

    @property
    def reference(self) -> float:
        """Position that the drive follows now."""
        return self._state.item(REFERENCE)

    def advance(self, to_ns: int) -> None:
        """Integrate up to `to_ns`; nothing happens when that is not in the future."""
        if not self._impulses:
            self._note_impulse()
        # By an end a millisecond before, the mean over the last one is exact.
        for end_ns in (to_ns - REPORTED_NS, to_ns):
            if end_ns > self.now_ns:
                self._integrate(end_ns - self.now_ns)
                self.now_ns = end_ns
                self._note_impulse()

    def _note_impulse(self) -> None:
        self._impulses.append((self.now_ns, self._state.item(IMPULSE)))

    def _integrate(self, span_ns: int) -> None:
        if not self._hides:
            self._head = self._advance(
                self.mode, self._deceleration, self._head, self.now_ns, span_ns
            )
            return
        history = (self._stamps, self._forces, self._head, self.now_ns, span_ns)
        self._head = advance_hidden(
            self._state,
            self._memories,
            self._constants,
            self._hidden,
            self.mode,
            self._deceleration,
            *history,
            self.now_ns - self._start_ns,
            self._scratch,
        )

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

    def push(self, force: float) -> None:
        """Push with a force, whatever the position."""
        self.mode = PUSHING
        self._constants[PUSH] = force

    def impede(
        self, target: float, rate: float, stiffness: float, damping: float, period_s: float
    ) -> None:
        """Act as a spring and damper to a moving target, as a motor with a loop of its own does."""
        self.mode = FOLLOWING
        self._constants[SERVO_STIFFNESS], self._constants[SERVO_DAMPING] = stiffness, damping
        self._state[REFERENCE] = target - rate * period_s
        self._state[REFERENCE_RATE], self._state[SEGMENT_LEFT] = rate, period_s

    def slow_down(self, deceleration: float) -> None:
        """Bring the reference to rest under power, from the speed that the tool has now."""
        self.mode = STOPPING
        self._state[REFERENCE_RATE] = self._state[VELOCITY]
        self._deceleration = deceleration

    @property
    def at_rest(self) -> bool:
        """Return whether the reference has come to rest."""
        return bool(self._state[REFERENCE_RATE] == 0.0)

    def measured_force(self) -> float:
        """Return what the force sensor gives now: the force of some time ago, and noise."""
        sensors = self.config.sensors
        # As `uniform(-1.0, 1.0)` draws it, which takes three times as long.
        jitter_us = (-1.0 + 2.0 * self._random.random()) * sensors.force_lag_jitter_us
        lag_ms = sensors.force_lag_ms + self._hidden.item(hidden.DELAY_MS)
        lag_ns = max(0, round(1e6 * lag_ms + 1e3 * jitter_us))
        lagged = self._force_at(self._head, self.now_ns - lag_ns)
        age_s = (self.now_ns - self._start_ns) * 1e-9
        lagged += sensors.force_offset + sensors.force_drift * age_s + self.hung
        return lagged + sensors.force_noise * self._random.standard_normal() + self._spark()

    def averaged_force(self, stamps_ns: Stamps, weights: Vector) -> float:
        """Return what a converter gives that weighs the sensor's force at these times (n,)."""
        sensors = self.config.sensors
        order = (self._head + 1 + np.arange(HISTORY)) % HISTORY
        lag_ns = round(1e6 * (sensors.force_lag_ms + self._hidden.item(hidden.DELAY_MS)))
        forces = np.interp(stamps_ns - lag_ns, self._stamps[order], self._forces[order])
        age_s = (int(stamps_ns[-1]) - self._start_ns) * 1e-9
        mean = float(weights @ forces) + sensors.force_offset + sensors.force_drift * age_s
        return (
            mean + self.hung + sensors.force_noise * self._random.standard_normal() + self._spark()
        )

    def _spark(self) -> float:
        """Return what an outlier adds, 0 for most samples."""
        share = self._hidden.item(hidden.SPARKS)
        if share == 0.0 or self._random.random() >= share:
            return 0.0
        size = float(self._hidden[hidden.SPARK_SIZE]) * self._random.uniform(0.7, 1.3)
        return size if self._random.random() < 0.5 else -size

    def truth(self) -> dict[str, Any]:
        """Return all that only the plant knows, in the rig's units."""
        return {
            "environment": self.config.environment.model_dump(),
            "sensors": self.config.sensors.model_dump(),
            "drive": self.config.drive.model_dump(),
            "undeclared": [effect.model_dump() for effect in self.config.undeclared],
        }


def _constants(config: SimulatedPlantConfig) -> Vector:
    """Return the constants of the kernel: servo gains from its bandwidth, the body's own."""
    drive, body = config.drive, config.environment
    natural = 2.0 * math.pi * drive.bandwidth_hz
    constants = np.zeros(CONSTANTS)
    constants[MASS] = drive.mass
    constants[SERVO_STIFFNESS] = drive.mass * natural**2
    constants[SERVO_DAMPING] = 2.0 * drive.damping_ratio * drive.mass * natural
    constants[SERVO_LIMIT] = drive.force_max
    constants[IDLE_DAMPING] = drive.idle_damping
    constants[STIFFNESS] = body.stiffness
    constants[DAMPING] = body.damping
    constants[SURFACE] = body.surface
    return constants


def hidden_constants(config: SimulatedPlantConfig) -> Vector:
    """Return the constants of `hidden.py`: the body's own, and those of every hidden effect."""
    body = config.environment
    constants = np.zeros(hidden.N_CONSTANTS)
    constants[hidden.STIFFNESS] = body.stiffness
    constants[hidden.DAMPING] = body.damping
    constants[hidden.SURFACE] = body.surface
    constants[hidden.EXPONENT], constants[hidden.EXPONENT_DEPTH] = body.power
    for effect in config.undeclared:
        for column, value in effect.constants().items():
            constants[column] = value
    return constants
