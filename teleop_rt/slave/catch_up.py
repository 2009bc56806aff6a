"""How a slave that begins to follow reaches the master's position."""

from __future__ import annotations

import math

from teleop_rt.kernels.jit import kernel
from teleop_rt.slave.record import Tick, TickRecord


@kernel
def caught_up(tick: Tick, target: float, velocity: float, command: float) -> float:
    """Return the target on the way from the last command, at the master's `velocity` or so."""
    gap = target - command
    reach = (tick.catch_up_speed + abs(velocity)) * tick.period_s
    if tick.behind == 0 or abs(gap) <= reach:
        tick.behind = 0
        return target
    return command + math.copysign(reach, gap)


class CatchUp:
    """Lets a slave that begins to follow catch up with the master at a safe speed.

    The hand has moved on by one link delay when the slave begins, to a place where no tool has
    been. A body on the way there must be met at the speed of a retreat, or of the hand, not at the
    axis' own fastest. The same holds when a contact that the slave waited for is acknowledged.
    """

    def __init__(self, speed: float, period_s: float, record: TickRecord | None = None) -> None:
        self._tick = (record or TickRecord()).tick
        self._tick.catch_up_speed, self._tick.period_s = speed, period_s

    def start(self) -> None:
        """Begin to follow."""
        self._tick.behind = 1

    def update(self, target: float, velocity: float, command: float) -> float:
        """Return the target of this cycle: see `caught_up`."""
        return caught_up(self._tick, target, velocity, command)
