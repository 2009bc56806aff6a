"""The last stage before the bus: no command leaves it beyond the rig's limits."""

from __future__ import annotations

import math

from teleop_rt.config.rig import Limits
from teleop_rt.kernels.jit import kernel
from teleop_rt.slave.record import Tick, TickRecord

_SAME_POSITION = 1e-12
"""Distance [rig unit] below which the goal is reached; rounding of doubles is smaller."""


@kernel
def inside(tick: Tick, position: float) -> float:
    """Return the nearest position within the range."""
    return min(max(position, tick.position_min), tick.position_max)


@kernel
def brakeable(tick: Tick, distance: float) -> float:
    """Return the largest velocity v with v + (v - s) + (v - 2s) + ... <= distance / period.

    s is the velocity that one cycle of acceleration_max takes away; n whole steps follow.
    """
    step = tick.velocity_step
    total = distance / tick.period_s
    n = math.floor((math.sqrt(1 + 8 * total / step) - 1) / 2)
    return (total + step * n * (n + 1) / 2) / (n + 1)


@kernel
def towards(tick: Tick, target: float) -> float:
    """Return the velocity that is wanted for `target`."""
    distance = target - tick.command
    wanted = distance / tick.period_s
    if abs(wanted - tick.command_velocity) <= tick.velocity_step:
        return wanted
    return math.copysign(min(abs(wanted), brakeable(tick, abs(distance))), wanted)


@kernel
def reachable(tick: Tick, velocity: float) -> float:
    """Return the nearest velocity within reach, pace, limit and the room left for braking."""
    before, step = tick.command_velocity, tick.velocity_step
    velocity = min(velocity, tick.pace)
    velocity = min(max(velocity, before - step), before + step)
    velocity = min(max(velocity, -tick.velocity_max), tick.velocity_max)
    highest = brakeable(tick, tick.position_max - tick.command)
    lowest = -brakeable(tick, tick.command - tick.position_min)
    return min(max(velocity, lowest), highest)


@kernel
def stand_at(tick: Tick, position: float) -> None:
    """Start from a position at rest; a position outside the range is brought inside."""
    tick.command = inside(tick, position)
    tick.command_velocity = 0.0


@kernel
def limit(tick: Tick, target: float) -> float:
    """Return the command of this cycle on the way to `target`; counts its changes.

    A target that is no number is not followed: the axis brakes to rest.
    """
    goal = inside(tick, target) if math.isfinite(target) else tick.command
    velocity = reachable(tick, towards(tick, goal))
    position = inside(tick, tick.command + velocity * tick.period_s)
    if abs(position - goal) < _SAME_POSITION:
        position = goal
    tick.command_velocity = velocity
    tick.command = position
    if position != target:
        tick.limited += 1
    return position


class Limiter:
    """Keeps each command finite and within the limits of position, velocity and acceleration.

    A motion that respects the limits is followed exactly. A target that is out of reach within
    one cycle is approached along the fastest profile that can still brake before it (to within
    three cycles' change of velocity), and every velocity can be braked before the range ends.
    """

    def __init__(self, limits: Limits, period_s: float, record: TickRecord | None = None) -> None:
        self._tick = tick = (record or TickRecord()).tick
        tick.period_s = period_s
        tick.position_min, tick.position_max = limits.position_min, limits.position_max
        tick.velocity_max = limits.velocity_max
        tick.velocity_step = limits.acceleration_max * period_s
        tick.pace = math.inf

    def reset(self, position: float) -> None:
        """Start from a position at rest; a position outside the range is brought inside."""
        stand_at(self._tick, position)

    @property
    def position(self) -> float:
        """The last command."""
        return float(self._tick.command)

    @property
    def limited(self) -> int:
        """How many commands were changed."""
        return int(self._tick.limited)

    def stand(self) -> None:
        """Go on from rest at the last command: a period after it the drive stood there.

        To go on with the velocity of before the gap would be a step, and to make up for the time
        that passed a larger one.
        """
        self._tick.command_velocity = 0.0

    def update(self, target: float) -> float:
        """Return the command of this cycle on the way to `target`: see `limit`."""
        return limit(self._tick, target)
