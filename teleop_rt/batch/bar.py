"""The progress bar on standard error, for people at a terminal."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, ProgressColumn, SpinnerColumn
from rich.progress import TimeElapsedColumn as Elapsed

REFRESH_HZ = 10.0
"""Often enough for an eye; more only takes time from the work."""


class Bar:
    """How many cases are done, or the phase of one by name; nothing where nobody watches.

    With `lines` each phase is a line of its own where standard error is no terminal. Standard
    output is left alone: answers may go to a file while the bar is shown.
    """

    def __init__(self, what: str, *, counts: bool = True, lines: bool = False) -> None:
        self._lines = lines and not sys.stderr.isatty()
        columns: tuple[ProgressColumn, ...] = (SpinnerColumn(), *Progress.get_default_columns()[:2])
        columns += (MofNCompleteColumn(), *Progress.get_default_columns()[2:]) if counts else ()
        self._progress = Progress(
            *columns,
            Elapsed(),
            console=Console(stderr=True),
            disable=not sys.stderr.isatty(),
            redirect_stdout=False,
            redirect_stderr=False,
            transient=not counts,
            refresh_per_second=REFRESH_HZ,
        )
        self._task = self._progress.add_task(what, total=None)

    def __call__(self, done: int, total: int) -> None:
        """Show how many of all are done."""
        self._progress.update(self._task, completed=done, total=total)

    def phase(self, name: str) -> None:
        """Show the current phase at once: a kernel may hold the drawing thread up."""
        if self._lines:
            print(f"{name} ...", file=sys.stderr, flush=True)
        self._progress.update(self._task, description=name, refresh=True)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """Take the bar away while something else is printed."""
        self._progress.stop()
        try:
            yield
        finally:
            self._progress.start()


@contextmanager
def bar(what: str, *, counts: bool = True, lines: bool = False) -> Iterator[Bar]:
    """Show a bar while the work goes on; without counts, one that shows phases only."""
    shown = Bar(what, counts=counts, lines=lines)
    with shown._progress:  # noqa: SLF001 - the bar's own
        yield shown
