"""The loop of a process: wait for the tick, run the cycle, until a stop request."""

from __future__ import annotations

from collections.abc import Callable

from teleop_rt.realtime.clock import Clock


def run_loop(
    clock: Clock, cycle: Callable[[int, int], None], should_stop: Callable[[], bool]
) -> None:
    """Call `cycle(skipped ticks, wake latency [ns])` on every tick until `should_stop()`."""
    while not should_stop():
        skipped = clock.wait_next_tick()
        cycle(skipped, clock.wake_latency_ns)
