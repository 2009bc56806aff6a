"""An error that a driver raised within a tick, in words: for the fault, and for the log."""

from __future__ import annotations

import traceback
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class DriverError:
    """The error as one line, and with its traceback; empty where none was raised."""

    said: str = ""
    traceback: str = ""


NONE_RAISED = DriverError()


def in_words(error: Exception) -> DriverError:
    """Return an error in words. It takes far longer than a tick: the axis is stopped before."""
    return DriverError(
        f"{type(error).__name__}: {error}", "".join(traceback.format_exception(error))
    )
