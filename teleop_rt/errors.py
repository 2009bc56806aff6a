"""Errors that more than one part raises."""

from __future__ import annotations


class RecordingError(Exception):
    """A recording cannot be used: says which, what is wrong, and what to do next."""
