"""Step several cycles of different rates in one process, in a fixed order, on simulated time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from teleop_rt.realtime.clock import SimulatedClock


@dataclass(slots=True)
class _Member:
    period_ns: int
    cycle: Callable[[], None]
    next_ns: int


class Lockstep:
    """A schedule of cycles; those due at the same time run in the order they were added."""

    def __init__(self, clock: SimulatedClock) -> None:
        self._clock = clock
        self.members: list[_Member] = []

    def add(self, period_ns: int, cycle: Callable[[], None]) -> None:
        """Call `cycle` every `period_ns`, first one period from now."""
        self.members.append(_Member(period_ns, cycle, self._clock.now_ns() + period_ns))

    def step(self) -> None:
        """Move time to the next deadline and run every cycle due then, once."""
        due_ns = min(member.next_ns for member in self.members)
        self._clock.move_to(due_ns)
        for member in self.members:
            if member.next_ns == due_ns:
                member.cycle()
                member.next_ns += member.period_ns
