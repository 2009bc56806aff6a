"""The last stage before the bus: no command leaves it beyond the rig's limits."""

from __future__ import annotations

import math

from teleop_rt.config_rig import Limits

_SAME_POSITION = 1e-12


class Limiter:
    """Keeps commands finite, within the range, and within velocity and acceleration.

    A motion that respects the limits is followed exactly. A target that is out of reach within
    one cycle is approached along the fastest profile that can still brake before it (to within
    three cycles' change of velocity), and every velocity can be braked before the range ends.
    """

    def __init__(self, limits: Limits, period_s: float) -> None:
        self._limits = limits
        self._period_s = period_s
        self._step = limits.acceleration_max * period_s
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

    def stand(self) -> None:
        """Go on from rest at the last command: a period after it the drive stood there.

        To go on with the velocity of before the gap would be a step, and to make up for the time
        that passed a larger one.
        """
        self._velocity = 0.0

    def update(self, target: float) -> float:
        """Return the command of this cycle on the way to `target`; counts what it changed.

        A target that is no number is not followed: the axis brakes to rest.
        """
        inside = self._inside(target) if math.isfinite(target) else self._position
        velocity = self._reachable(self._towards(inside))
        position = self._inside(self._position + velocity * self._period_s)
        if abs(position - inside) < _SAME_POSITION:
            position = inside
        self._velocity = velocity
        self._position = position
        self.limited += position != target
        return position

    def _towards(self, target: float) -> float:
        """Return the velocity that is wanted for `target`."""
        distance = target - self._position
        wanted = distance / self._period_s
        if abs(wanted - self._velocity) <= self._step:
            return wanted
        return math.copysign(min(abs(wanted), self._brakeable(abs(distance))), wanted)

    def _reachable(self, velocity: float) -> float:
        """Return the nearest velocity within reach, limit and what the range lets brake."""
        limits = self._limits
        velocity = min(max(velocity, self._velocity - self._step), self._velocity + self._step)
        velocity = min(max(velocity, -limits.velocity_max), limits.velocity_max)
        highest = self._brakeable(limits.position_max - self._position)
        lowest = -self._brakeable(self._position - limits.position_min)
        return min(max(velocity, lowest), highest)

    def _brakeable(self, distance: float) -> float:
        """Largest velocity v with v + (v - s) + (v - 2s) + ... <= distance / period.

        s is the velocity that one cycle of acceleration_max takes away; n whole steps follow.
        """
        step = self._step
        total = distance / self._period_s
        n = math.floor((math.sqrt(1 + 8 * total / step) - 1) / 2)
        return (total + step * n * (n + 1) / 2) / (n + 1)

    def _inside(self, position: float) -> float:
        return min(max(position, self._limits.position_min), self._limits.position_max)
