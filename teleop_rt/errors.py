"""The base of every error that a user can mend, and those that more than one part raises."""

from __future__ import annotations

FAULT, BAD_INPUT = 1, 2
"""Exit codes: for a fault during the work, and for arguments, config or input that are refused."""


class ExpectedError(Exception):
    """An error with cause, place and next step: the command line prints it and exits.

    `code` is its exit code: 1 for a fault during the work, 2 for bad arguments, config or input.
    """

    code = BAD_INPUT


class RecordingError(ExpectedError):
    """A recording cannot be used; the message names it, the cause and the next step."""
