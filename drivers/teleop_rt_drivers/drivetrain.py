"""The force at the tool from that of the motor: less those of friction and moved mass."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pydantic import Field

from teleop_rt.config.section import Damping, Force, Mass, Section

if TYPE_CHECKING:
    from teleop_rt.axis import Sample

FORCE_NOT_COMPARED = "force is the drive's own torque: no force sensor is compared with it"
HALF_WINDOW_NS = 4_000_000
"""Before and after the time that a force belongs to: a count of 1 um is then 0.04 m/s2 of noise."""
SLOW_SHARE = 0.01
"""Of velocity_max: below it dry friction is anything between its two signs, here in proportion."""


class DrivetrainConfig(Section):
    """Friction and mass between motor and tool; `calibrate drivetrain` writes them."""

    coulomb_friction: Force = Field(0.0, ge=0, description="Dry friction, against the motion.")
    viscous_friction: Damping = Field(0.0, ge=0, description="Friction per unit of velocity.")
    mass: Mass = Field(
        0.0, ge=0, description="Mass (or inertia) that the motor moves, its own rotor's with it."
    )
    torque_lag_ms: float = Field(
        0.0,
        ge=0,
        le=4,
        description="Lag of the reported torque behind the position: half the time it is averaged.",
    )


def periods_behind(config: DrivetrainConfig, period_ns: int) -> int:
    """Return how many periods a freed force is older than the newest sample."""
    return _half_window(period_ns) + _waiting(config, period_ns)


def _half_window(period_ns: int) -> int:
    return max(1, round(HALF_WINDOW_NS / period_ns))


def _waiting(config: DrivetrainConfig, period_ns: int) -> int:
    """Return how many periods a position waits for the torque that lags it."""
    return math.ceil(1e6 * config.torque_lag_ms / period_ns)


class Drivetrain:
    """Subtracts friction and the inertia of a mass from a motor's force; allocates nothing.

    The second difference of positions is the acceleration in a triangular window; in the same
    window the force is averaged, so that a mass's inertia cancels however fast it changes. So a
    force comes half a window later than it was measured, and `stamp_ns` is its time.
    """

    def __init__(self, config: DrivetrainConfig, velocity_max: float, period_ns: int) -> None:
        self._coulomb, self._viscous = config.coulomb_friction, config.viscous_friction
        self._mass = config.mass
        self._slow = SLOW_SHARE * velocity_max
        self._half = _half_window(period_ns)
        self._late = _waiting(config, period_ns)
        size = 2 * self._half + 1 + self._late
        self._weights = _triangle(size, self._half, 1e6 * config.torque_lag_ms / period_ns)
        self._positions, self._forces = [0.0] * size, [0.0] * size
        self._stamps_ns = [0] * size
        self.reset()

    def reset(self) -> None:
        """Forget all measurements."""
        self._newest = self._count = 0
        self.force, self.stamp_ns = 0.0, -1

    def free(self, sample: Sample) -> None:
        """Put the freed force in place of the motor's, with its own stamp."""
        if sample.valid:
            self.take(sample.position_stamp_ns, sample.position, sample.force)
        sample.force, sample.force_stamp_ns = self.force, self.stamp_ns

    def take(self, stamp_ns: int, position: float, force: float) -> None:
        """Take a measurement at a time later than that of the last."""
        size = len(self._stamps_ns)
        if self._count and stamp_ns <= self._stamps_ns[self._newest]:
            return
        newest = self._newest = (self._newest + 1) % size
        self._stamps_ns[newest] = stamp_ns
        self._positions[newest], self._forces[newest] = position, force
        self._count = min(self._count + 1, size)
        middle = (newest - min(self._count - 1, self._late + self._half)) % size
        self.stamp_ns = self._stamps_ns[middle]
        if self._count < size:  # late from the first on: no stamp is followed by an earlier one
            self.force = self._forces[middle]
            return
        oldest, forces = newest + 1, self._forces
        pushed = 0.0
        for place, weight in enumerate(self._weights, oldest):
            pushed += weight * forces[place % size]
        self.force = pushed - self._taken(oldest % size, middle, (newest - self._late) % size)

    def _taken(self, first: int, middle: int, last: int) -> float:
        """Return the part of the motor's force that friction and mass take at the middle place."""
        stamps_ns, positions = self._stamps_ns, self._positions
        before_s = (stamps_ns[middle] - stamps_ns[first]) * 1e-9
        after_s = (stamps_ns[last] - stamps_ns[middle]) * 1e-9
        before = (positions[middle] - positions[first]) / before_s
        after = (positions[last] - positions[middle]) / after_s
        velocity = (after_s * before + before_s * after) / (before_s + after_s)
        acceleration = 2.0 * (after - before) / (before_s + after_s)
        dry = min(max(velocity / self._slow, -1.0), 1.0)
        return self._coulomb * dry + self._viscous * velocity + self._mass * acceleration


def _triangle(size: int, half: int, lag: float) -> tuple[float, ...]:
    """Return weights (size,) of a triangle of `half` periods, `lag` periods after its middle."""
    heights = [max(0.0, 1.0 - abs(place - half - lag) / half) for place in range(size)]
    return tuple(height / sum(heights) for height in heights)
