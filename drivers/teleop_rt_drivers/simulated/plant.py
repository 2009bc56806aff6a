"""The plant: tool, drive and environment, and the sensors on them.

Its physics are its own: nothing here is shared with the models that are estimated from it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.simulated import hidden, senses
from teleop_rt_drivers.simulated.hidden_motion import N_ALL, STAGES
from teleop_rt_drivers.simulated.motion import (
    CONSTANTS,
    DAMPING,
    DECELERATION,
    FOLLOWING,
    FORCE,
    HISTORY,
    IDLE_DAMPING,
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
    STIFFNESS,
    STOPPING,
    SURFACE,
    VELOCITY,
    contact_force,
    follow,
)

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
    from teleop_rt_drivers.simulated.motion import Stamps, Vector


class Plant:
    """Tool, drive and environment, and the sensors on them; all random numbers from one seed."""

    def __init__(self, config: SimulatedPlantConfig, start_ns: int, seed: int) -> None:
        self.config = config
        self._random = np.random.default_rng(seed)
        self._state = np.zeros(STATES)
        self._state[POSITION] = self._state[REFERENCE] = config.start
        self._constants = _constants(config)
        self._state[FORCE] = contact_force(config.start, 0.0, self._constants)
        self._stamps = np.full(HISTORY, start_ns, dtype=np.int64)
        self._forces = np.full(HISTORY, self._state[FORCE])
        self._numbers = np.zeros(senses.NUMBERS, np.int64)
        self._numbers[[senses.NOW, senses.START]] = start_ns
        self._numbers[senses.MODE] = OFF
        self._hides = bool(config.undeclared or config.environment.hunt_crossley)
        self._hidden = hidden_constants(config)
        self._sensor = _sensor_constants(config, self._hidden.item(hidden.DELAY_MS))
        self.moving = senses.PlantArrays(
            state=self._state,
            constants=self._constants,
            numbers=self._numbers,
            stamps=self._stamps,
            forces=self._forces,
            impulse_ns=np.zeros(senses.IMPULSES, np.int64),
            impulses=np.zeros(senses.IMPULSES),
            sensor=self._sensor,
            draws=np.zeros((senses.DRAWS, 2)),
        )
        """Its arrays, for kernels that compute a device's whole answer."""
        self._compile()

    def _compile(self) -> None:
        """Compile the kernels, so that the first SYNC is answered in time."""
        self.beside = self._beside()
        self._run_to = bound(senses.run_to, (self.moving, self.beside), 0)
        self._measured_force = bound(senses.measured_force, (self.moving,))
        self._mean_servo_force = bound(senses.mean_servo_force, (self.moving,), 0)

    def _beside(self) -> senses.Hidden | None:
        """Return the arrays of the trial's hidden effects, if it has any."""
        if not self._hides:
            return None
        memories = np.zeros(hidden.N_MEMORIES)
        memories[hidden.TIP] = self.config.start
        return senses.Hidden(memories, self._hidden, np.zeros((STAGES, N_ALL)))

    @property
    def answers(self) -> bool:
        """Return whether a kernel may compute its devices' answers: none knows of outliers."""
        return self._hidden.item(hidden.SPARKS) == 0.0

    @property
    def now_ns(self) -> int:
        """The time up to which it has moved."""
        return self._numbers.item(senses.NOW)

    @property
    def mode(self) -> int:
        """The state of the drive."""
        return self._numbers.item(senses.MODE)

    @mode.setter
    def mode(self, mode: int) -> None:
        self._numbers[senses.MODE] = mode

    @property
    def hung(self) -> float:
        """Force of a weight that hangs at the force sensor."""
        return self._sensor.item(senses.HUNG)

    @hung.setter
    def hung(self, force: float) -> None:
        self._sensor[senses.HUNG] = force

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
        read, number = self._state.item, self._numbers.item
        return [
            number(senses.NOW), read(POSITION), read(VELOCITY), read(FORCE), read(REFERENCE),
            number(senses.MODE),
        ]  # fmt: skip

    @property
    def encoder_counts(self) -> float:
        """Position as the encoder counts it, not rounded."""
        sensors = self.config.sensors
        return senses.in_counts(self.position, sensors.encoder_zero, sensors.encoder_resolution)

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
        drive = self.config.drive
        return senses.in_counts(position, drive.zero, drive.position_resolution)

    def position_of(self, counts: float) -> float:
        """Return the true position of the drive's counts."""
        return self.config.drive.zero + counts * self.config.drive.position_resolution

    @property
    def servo_force(self) -> float:
        """Force of the drive on the tool, its mean over the last millisecond."""
        return self.mean_servo_force(senses.REPORTED_NS)

    def mean_servo_force(self, span_ns: int) -> float:
        """Return the drive's mean force over this time, however often the plant was asked."""
        return self._mean_servo_force(span_ns)

    @property
    def reference(self) -> float:
        """Position that the drive follows now."""
        return self._state.item(REFERENCE)

    def advance(self, to_ns: int) -> None:
        """Integrate up to `to_ns`; nothing happens when that is not in the future."""
        self._run_to(to_ns)

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
        follow(self._state, target, period_s)

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
        self._constants[DECELERATION] = deceleration

    @property
    def at_rest(self) -> bool:
        """Return whether the reference has come to rest."""
        return bool(self._state[REFERENCE_RATE] == 0.0)

    def measured_force(self) -> float:
        """Return the force sensor's present reading: the force of some time ago, and noise."""
        self.draw(1)
        return self._measured_force() + self._spark()

    def draw(self, samples: int) -> None:
        """Draw the random numbers of so many samples, if fewer than that are left.

        An outlier's numbers come between two samples': with outliers one is drawn at a time.
        """
        numbers, draws = self._numbers, self.moving.draws
        first, last = numbers.item(senses.NEXT_DRAW), numbers.item(senses.DRAWN)
        if last - first >= samples:
            return
        left = last - first
        draws[:left] = draws[first:last]
        count = len(draws) if self.answers else samples
        uniform, normal = self._random.random, self._random.standard_normal
        draws[left:count] = [(uniform(), normal()) for _ in range(left, count)]
        numbers[senses.NEXT_DRAW], numbers[senses.DRAWN] = 0, count

    def averaged_force(self, stamps_ns: Stamps, weights: Vector) -> float:
        """Return the readings of a converter of the sensor's force at these times (n,)."""
        sensors = self.config.sensors
        order = (self._numbers.item(senses.HEAD) + 1 + np.arange(HISTORY)) % HISTORY
        lag_ns = round(1e6 * self._sensor.item(senses.LAG_MS))
        forces = np.interp(stamps_ns - lag_ns, self._stamps[order], self._forces[order])
        age_s = (int(stamps_ns[-1]) - self._numbers.item(senses.START)) * 1e-9
        mean = float(weights @ forces) + sensors.force_offset + sensors.force_drift * age_s
        return (
            mean + self.hung + sensors.force_noise * self._random.standard_normal() + self._spark()
        )

    def _spark(self) -> float:
        """Return the force of an outlier, 0 for most samples."""
        share = self._hidden.item(hidden.SPARKS)
        if share == 0.0 or self._random.random() >= share:
            return 0.0
        size = float(self._hidden[hidden.SPARK_SIZE]) * self._random.uniform(0.7, 1.3)
        return size if self._random.random() < 0.5 else -size

    def truth(self) -> dict[str, Any]:
        """Return all that only the plant knows, in the rig's units."""
        return {
            "start": self.config.start,
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


def _sensor_constants(config: SimulatedPlantConfig, delay_ms: float) -> Vector:
    """Return the constants of the force sensor, whose force a hidden effect may delay further."""
    sensors = config.sensors
    constants = np.zeros(senses.SENSOR_CONSTANTS)
    constants[senses.LAG_MS] = sensors.force_lag_ms + delay_ms
    constants[senses.JITTER_US] = sensors.force_lag_jitter_us
    constants[senses.OFFSET], constants[senses.DRIFT] = sensors.force_offset, sensors.force_drift
    constants[senses.NOISE] = sensors.force_noise
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
