"""The last stage before the bus: no command leaves it beyond the rig's limits."""

from __future__ import annotations

import math

from teleop_rt.config import Limits


class Limiter:
    """Keeps commands finite, within the range, and within velocity and acceleration.

    The velocity towards a target is also kept below what can still be braked before it, so a
    target at the end of the range is reached without passing it.
    """

    def __init__(self, limits: Limits, period_s: float) -> None:
        self._limits = limits
        self._period_s = period_s
        self._position = 0.0
        self._velocity = 0.0
        self.limited = 0

    def reset(self, position: float) -> None:
        """Start from a position at rest; a position outside the range is brought inside."""
        self._position = self._inside(position)
        self._velocity = 0.0

    @property
    def position(self) -> float:
        """The last command."""
        return self._position

    def update(self, target: float) -> float:
        """Return the command of this cycle on the way to `target`; counts what it changed.

        A target that is no number is not followed: the axis brakes to rest.
        """
        limits, dt = self._limits, self._period_s
        inside = self._inside(target) if math.isfinite(target) else self._position
        wanted = (inside - self._position) / dt
        step = limits.acceleration_max * dt
        braking = self._braking_velocity(abs(inside - self._position), step)
        speed = min(limits.velocity_max, braking)
        velocity = min(max(wanted, -speed), speed)
        velocity = min(max(velocity, self._velocity - step), self._velocity + step)
        position = self._inside(self._position + velocity * dt)
        self._velocity = (position - self._position) / dt
        self._position = position
        self.limited += position != target
        return position

    def _braking_velocity(self, distance: float, step: float) -> float:
        """Largest velocity from which `distance` is not overrun when it falls by `step` a cycle."""
        dt = self._period_s
        return math.sqrt(step * step / 4 + 2 * step / dt * distance) - step / 2 + 1e-12

    def _inside(self, position: float) -> float:
        return min(max(position, self._limits.position_min), self._limits.position_max)
