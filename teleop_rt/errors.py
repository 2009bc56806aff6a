"""The base of every error that a user can mend, and those that more than one part raises."""

from __future__ import annotations

BAD_INPUT = 2


class ExpectedError(Exception):
    """An error with cause, place and next step: the command line prints it and exits.

    `code` is its exit code: 1 for a fault during the work, 2 for bad arguments, config or input.
    """

    code = BAD_INPUT


class RecordingError(ExpectedError):
    """A recording cannot be used: says which, what is wrong, and what to do next."""
