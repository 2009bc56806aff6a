"""Two clocks, one interface: the machine's monotonic clock and a simulated one."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

WATCHED_UP_TO_NS = 60_000
"""Before a deadline: work on an arrival must not make the tick late."""
AHEAD_NS = 120_000
"""Before a deadline: a late wake-up and the work that is done ahead of a tick fit in, cold."""
LEAD_UP_TO_NS = 50_000
"""Before a deadline: the most that a sleep ends earlier, however late sleeps end as a rule."""
LEAD_RISE_NS, LEAD_FALL_NS = 250, 750
"""Per sleep, later or earlier than the lead: they balance at one sleep in four that is earlier."""


class Clock(Protocol):
    """The interface of a loop's clock."""

    def now_ns(self) -> int:
        """Return monotonic time."""

    def wait_next_tick(self) -> int:
        """Wait for the next deadline on the grid; return how many deadlines were skipped."""

    @property
    def wake_latency_ns(self) -> int:
        """How long after the deadline that it slept for the last tick woke up."""


class RealClock:
    """Absolute deadlines on the monotonic clock: late ticks are skipped, never caught up.

    A sleep ends as long before the deadline as three quarters of the sleeps were late, and the time
    left is waited for awake: one tick in four, for a few microseconds (`awake_ns`).
    With `spin_ns`, at least that long before each deadline is waited for without sleep: it costs a
    core's time, and wakes up nearer to the deadline. `watch` waits for so many seconds in place of
    sleep, and notes arrivals meanwhile, except in the last WATCHED_UP_TO_NS. `ahead` is work that a
    tick is spared: it is done AHEAD_NS before the deadline, where the tick before leaves time for
    it.
    """

    def __init__(
        self,
        period_ns: int,
        spin_ns: int = 0,
        watch: Callable[[float], None] | None = None,
        ahead: Callable[[], None] | None = None,
    ) -> None:
        self.period_ns = period_ns
        self._spin_ns = spin_ns
        self._watch, self._ahead = watch, ahead
        self.wake_latency_ns = self.awake_ns = 0
        self._lead_ns = 0
        self._deadline_ns = time.monotonic_ns()

    def now_ns(self) -> int:
        """Return monotonic time."""
        return time.monotonic_ns()

    def wait_next_tick(self) -> int:
        """Sleep until the next deadline; deadlines past by then, or by waking, are skipped.

        The grid never moves, so the rate does not drift however late a tick is. Who overslept
        learns it with this tick: the one after it would be too late to hold.
        """
        late_ns = time.monotonic_ns() - self._deadline_ns
        skipped = max(0, late_ns // self.period_ns)
        self._deadline_ns += (skipped + 1) * self.period_ns
        watch = self._watch
        if self._ahead is not None and self._waited(watch or time.sleep, AHEAD_NS):
            self._ahead()
        if watch is not None:
            self._waited(watch, WATCHED_UP_TO_NS)
        remaining_ns = self._slept()
        self.awake_ns = max(0, remaining_ns)
        while remaining_ns > 0:
            remaining_ns = self._deadline_ns - time.monotonic_ns()
        self.wake_latency_ns = -remaining_ns
        overslept = self.wake_latency_ns // self.period_ns
        self._deadline_ns += overslept * self.period_ns
        return skipped + overslept

    def _slept(self) -> int:
        """Sleep until shortly before the deadline, learn from it, and return the time left [ns]."""
        before_ns = max(self._spin_ns, self._lead_ns)
        remaining_ns = self._deadline_ns - time.monotonic_ns()
        if remaining_ns <= before_ns:
            return remaining_ns
        time.sleep((remaining_ns - before_ns) * 1e-9)
        remaining_ns = self._deadline_ns - time.monotonic_ns()
        if before_ns - remaining_ns > self._lead_ns:
            self._lead_ns = min(self._lead_ns + LEAD_RISE_NS, LEAD_UP_TO_NS)
        else:
            self._lead_ns = max(self._lead_ns - LEAD_FALL_NS, 0)
        return remaining_ns

    def _waited(self, wait: Callable[[float], None], before_ns: int) -> bool:
        """Wait until so long before the deadline, and before spinning; false if it is later."""
        free_ns = self._deadline_ns - time.monotonic_ns() - self._spin_ns - before_ns
        if free_ns > 0:
            wait(free_ns * 1e-9)
        return free_ns > 0


class SimulatedClock:
    """Time that moves only on request."""

    wake_latency_ns = 0

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return simulated time."""
        return self._now_ns

    def move_to(self, now_ns: int) -> None:
        """Move time forward. Raises ValueError for a step backwards."""
        if now_ns < self._now_ns:
            raise ValueError(f"time cannot go back from {self._now_ns} to {now_ns} ns")
        self._now_ns = now_ns
