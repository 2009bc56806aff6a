"""The pace of a measurement that a person waits for."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from teleop_rt.terminal import ElapsedLine


class Pace:
    """Waits for the next cycle of an absolute grid, from the first call on."""

    def __init__(self, period_ns: int, line: ElapsedLine) -> None:
        self._period_ns = period_ns
        self._next_ns = 0
        self._line = line

    def wait(self) -> None:
        """Sleep until the next cycle; cycles missed are skipped."""
        self._line.tick()
        now_ns = time.monotonic_ns()
        self._next_ns = max(self._next_ns + self._period_ns, now_ns)
        time.sleep((self._next_ns - now_ns) * 1e-9)


BEGIN_NS = 10**12
"""Of simulated time: devices have been without power for long."""


class SimulatedPace:
    """Simulated time, a period further with each wait."""

    def __init__(self, period_ns: int) -> None:
        self._period_ns = period_ns
        self._now_ns = BEGIN_NS

    def now_ns(self) -> int:
        """Return the simulated time."""
        return self._now_ns

    def wait(self) -> None:
        """Let a period pass."""
        self._now_ns += self._period_ns


@contextmanager
def paced(name: str, period_ns: int) -> Iterator[Pace]:
    """Give the pace of a measurement, whose name and duration a terminal shows meanwhile."""
    with ElapsedLine(name) as line:
        yield Pace(period_ns, line)
