"""Standard output whose reader may go away, or know few characters: nobody's fault."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Self, TextIO

_PLAIN = str.maketrans({"±": "+-", "✓": "+", "✕": "x", "–": "-", "→": "->", "µ": "u", "²": "^2"})
"""Stand-ins for characters that an encoding may lack; others become a question mark."""
REWRITTEN_S = 0.5
"""Period of a line that shows how long a measurement goes on [s]."""


class _ForgivingOutput:
    """Passes text on; once the reader has gone, to nowhere.

    Characters that its encoding lacks (ASCII, Latin-1) are replaced, so that no result is lost.
    """

    def __init__(self, output: TextIO) -> None:
        self._output = output

    def write(self, text: str) -> int:
        """Write text."""
        try:
            return self._output.write(text)
        except UnicodeEncodeError as error:
            plain = text.translate(_PLAIN).encode(error.encoding, "replace")
            return self.write(plain.decode(error.encoding))
        except BrokenPipeError:
            self._to_nowhere()
            return len(text)

    def flush(self) -> None:
        """Hand the written text on."""
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
    """Return text that a terminal shows in red; unchanged where standard output goes elsewhere."""
    coloured = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    return f"\x1b[1;31m{text}\x1b[0m" if coloured else text


class ElapsedLine:
    """A line on standard error with the name and duration of a measurement; for a terminal only.

    The measuring loop rewrites it by `tick`: a drawing thread would make that loop late.
    """

    def __init__(self, name: str) -> None:
        self._name, self._shown = name, sys.stderr.isatty()
        self._begun_s = self._next_s = 0.0

    def __enter__(self) -> Self:
        self._begun_s = self._next_s = time.monotonic()
        self.tick()
        return self

    def tick(self) -> None:
        """Rewrite the line where the last time was half a second ago."""
        now_s = time.monotonic()
        if self._shown and now_s >= self._next_s:
            self._next_s = now_s + REWRITTEN_S
            self._write(f"\r{self._name} ... {now_s - self._begun_s:.1f} s")

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._write("\r\x1b[K")

    def _write(self, text: str) -> None:
        sys.stderr.write(text)
        sys.stderr.flush()
