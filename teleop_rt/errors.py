"""The base of every error that a user can mend, and those that more than one part raises."""

from __future__ import annotations

from pathlib import Path

BAD_INPUT = 2


class ExpectedError(Exception):
    """What is wrong, where, and what to do next: the command line prints it and leaves.

    `code` is its exit code: 1 for a fault during the work, 2 for bad arguments, config or input.
    """

    code = BAD_INPUT


class RecordingError(ExpectedError):
    """A recording cannot be used: says which, what is wrong, and what to do next."""


def refuse_existing(path: Path, what_next: str = "name another file") -> None:
    """Raise RecordingError where a file that would be written exists: nothing is overwritten."""
    if path.exists():
        raise RecordingError(f"{path}: exists already: {what_next}, or remove it")
