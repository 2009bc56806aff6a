"""Standard output whose reader may go away: what is left unread is nobody's fault."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO


class _ForgivingOutput:
    """Passes text on; once the reader has gone, to nowhere."""

    def __init__(self, output: TextIO) -> None:
        self._output = output

    def write(self, text: str) -> int:
        """Write text."""
        try:
            return self._output.write(text)
        except BrokenPipeError:
            self._to_nowhere()
            return len(text)

    def flush(self) -> None:
        """Hand on what was written."""
        try:
            self._output.flush()
        except BrokenPipeError:
            self._to_nowhere()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._output, name)

    def _to_nowhere(self) -> None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self._output.fileno())
        os.close(nowhere)


@contextmanager
def pipe_that_may_close() -> Iterator[None]:
    """Let `teleop-rt ... | head` end quietly, with the exit code of the work."""
    forgiving: Any = _ForgivingOutput(sys.stdout)
    with contextlib.redirect_stdout(forgiving):
        try:
            yield
        finally:
            forgiving.flush()


def red(text: str) -> str:
    """Return text that a terminal shows in red; unchanged where standard output is none."""
    coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    return f"\x1b[1;31m{text}\x1b[0m" if coloured else text
