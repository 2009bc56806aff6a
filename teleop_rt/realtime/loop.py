"""The loop of a process: wait for the tick, run the cycle, until a stop request."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from teleop_rt.realtime.clock import Clock

_INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class StopRequest:
    """True once SIGTERM, SIGINT or SIGHUP has come; made in the main thread."""

    def __init__(self) -> None:
        self._requested = False
        for number in _INTERRUPTS:
            signal.signal(number, self._request)

    def __call__(self) -> bool:
        """Return whether the process was asked to stop."""
        return self._requested

    def _request(self, _number: int, _frame: FrameType | None) -> None:
        self._requested = True


@contextmanager
def deferred_interrupts() -> Iterator[None]:
    """Let an interrupt that comes inside take effect only at the end."""
    came: list[int] = []
    before = {
        number: signal.signal(number, lambda other, _frame: came.append(other))
        for number in _INTERRUPTS
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


class Interrupts:
    """Turns the first SIGINT, SIGTERM or SIGHUP into KeyboardInterrupt and ignores the rest.

    Inside, what has to be finished after an interrupt is not interrupted again.
    """

    def __enter__(self) -> Interrupts:
        """Take the signals over."""
        self._before = [signal.signal(number, self._raise) for number in _INTERRUPTS]
        return self

    def __exit__(self, *_: object) -> None:
        """Give the signals back."""
        for number, handler in zip(_INTERRUPTS, self._before, strict=True):
            signal.signal(number, handler)

    def ignore(self) -> None:
        """Let nothing interrupt what comes now."""
        for number in _INTERRUPTS:
            signal.signal(number, signal.SIG_IGN)

    def _raise(self, _number: int, _frame: FrameType | None) -> None:
        self.ignore()
        raise KeyboardInterrupt


def run_loop(
    clock: Clock, cycle: Callable[[int, int], None], should_stop: Callable[[], bool]
) -> None:
    """Call `cycle(skipped ticks, wake latency [ns])` on every tick until `should_stop()`."""
    while not should_stop():
        skipped = clock.wait_next_tick()
        cycle(skipped, clock.wake_latency_ns)
