"""The effect of SIGINT, SIGTERM and SIGHUP: interrupt, ask a loop to stop, or wait."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

INTERRUPTS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTED = 130
"""Exit code of a command that an interrupt ended: a shell's, of a program ended by SIGINT."""
_came: list[int] = []


def interrupt(number: int, _frame: FrameType | None) -> None:
    """Interrupt the main thread, as a handler of a signal. Raises KeyboardInterrupt."""
    _came.append(number)
    raise KeyboardInterrupt


def interruptions() -> int:
    """Return how often this process was interrupted, be it handled or not."""
    return len(_came)


def interrupted() -> bool:
    """Return whether this process was ever interrupted, be it handled or not."""
    return bool(_came)


class StopRequest:
    """True once SIGTERM, SIGINT or SIGHUP has come; made in the main thread."""

    def __init__(self) -> None:
        self._requested = False
        for number in INTERRUPTS:
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
        for number in INTERRUPTS
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


class Interrupts:
    """Turns the first SIGINT, SIGTERM or SIGHUP into KeyboardInterrupt and holds the rest.

    Inside, the work that must be finished after an interrupt is not interrupted again.
    """

    def __enter__(self) -> Interrupts:
        """Take the signals over."""
        self._began = interruptions()
        self._before = [signal.signal(number, self._raise) for number in INTERRUPTS]
        return self

    def __exit__(self, *_: object) -> None:
        """Give the signals back."""
        for number, handler in zip(INTERRUPTS, self._before, strict=True):
            signal.signal(number, handler)

    @property
    def came(self) -> bool:
        """Whether an interrupt has come inside, be it raised or held."""
        return interruptions() > self._began

    def hold(self) -> None:
        """Let nothing interrupt the following steps; `came` says whether something wanted to."""
        for number in INTERRUPTS:
            signal.signal(number, self._note)

    def _raise(self, number: int, frame: FrameType | None) -> None:
        self.hold()
        interrupt(number, frame)

    def _note(self, number: int, _frame: FrameType | None) -> None:
        _came.append(number)
