"""Where the text of a command goes."""

from __future__ import annotations

import sys

from rich.console import Console

_UNWRAPPED = 1000
"""Characters: a file or a pipe is no terminal, to whose width a line would have to keep."""


def output() -> Console:
    """Return standard output: wrapped to the width of a terminal, unwrapped elsewhere."""
    return Console(width=None if sys.stdout.isatty() else _UNWRAPPED)
