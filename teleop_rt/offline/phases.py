"""The phases of a long command by name and time, on standard error."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager

from teleop_rt.batch.bar import Bar, bar
from teleop_rt.diagnosis.phases import heard_by


class Phases:
    """Names each phase when it begins, and its duration when it ends.

    A phase with its own display, such as a run, gets no bar beside it. Work between phases is
    part of `between`, with a bar that names it.
    """

    def __init__(self, between: str, *, quiet: bool) -> None:
        self._between, self._quiet = between, quiet
        self._bar: Bar | None = None
        self._begun_s = 0.0
        self._open = ExitStack()
        self.taken: list[dict[str, str | float]] = []

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        """Count the work within as one phase."""
        self.end()
        self._say(f"{name} ...")
        begun_s = time.perf_counter()
        yield
        self._took(name, begun_s)

    def heard(self, phase: str) -> None:
        """Show the work between phases."""
        if self._bar is None:
            self._begun_s = time.perf_counter()
            self._say(f"{self._between} ...")
            self._bar = self._open.enter_context(bar(phase, counts=False, lines=not self._quiet))
        self._bar.phase(phase)

    def end(self) -> None:
        """End the work between phases."""
        if self._bar is not None:
            self._open.close()
            self._bar = None
            self._took(self._between, self._begun_s)

    def _took(self, name: str, begun_s: float) -> None:
        seconds = time.perf_counter() - begun_s
        self.taken.append({"name": name, "seconds": round(seconds, 1)})
        self._say(f"{name}: {seconds:.1f} s")

    def _say(self, words: str) -> None:
        if not self._quiet:
            print(words, file=sys.stderr, flush=True)


@contextmanager
def phases_of_command(between: str, *, quiet: bool) -> Iterator[Phases]:
    """Give the phases of a command, and hear those of a diagnosis meanwhile."""
    shown = Phases(between, quiet=quiet)
    listener: Callable[[str], None] = shown.heard
    with heard_by(listener):
        try:
            yield shown
        finally:
            shown.end()
