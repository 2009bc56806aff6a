"""Doubt of the unit of a force that no file states."""

from __future__ import annotations

import numpy as np

from teleop_rt.recordings.recording import Recording

_WEAKEST_N = 0.1
"""Range of a force in N below which its unit is doubted: tissue under a finger gives ten times it,
and a force in kN is a thousand times too small."""


def weak_force(recording: Recording) -> str | None:
    """Return the note that the unit of a force may be another one, None where it is stated."""
    if recording.units_stated or recording.units[1] != "N":
        return None
    span = float(np.ptp(recording.force[recording.mask > 0.0]))
    if span >= _WEAKEST_N:
        return None
    return (
        f"is the unit right? no column states its unit, and the force varies by only {span:.2g} N:"
        " if it is in kN, say so with --units force=kN"
    )
