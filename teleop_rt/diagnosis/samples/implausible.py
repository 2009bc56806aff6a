"""Units that no rig has: a doubt where another unit fits, and a refusal."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.samples.exchanged import exchange_note
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.column_names import exchanged
from teleop_rt.recordings.recording import Recording

_STIFFEST_N_PER_M = 1e6  # N/m; no rig of this kind presses on anything stiffer
_STIFFEST_STATED_N_PER_M = 1e9  # N/m; nor is anything in a testing machine, whose units are known
_STATE_UNITS = "; if they are right, state them with --units position=m --units force=N"
_LONGEST_M = 2.0  # m; no rig here travels farther
_FAR_M, _SOFT_N_PER_M = 0.3, 100.0
"""A softer body moved farther: 0.3 mm and 100 kN/m, as of a rig, if its mm were taken for m."""
_NEAR_M, _HARD_N_PER_M = 3e-5, 1e6
"""A stiffer body moved less: 30 mm and 1 kN/m, as of a rig, if its m were taken for mm."""


def doubtful_unit(unit: str, travel: float, stiffness: float) -> str | None:
    """Return a note where travel and stiffness [m, N/m] are those of a rig in another unit only."""
    if unit != "m":
        return None
    if travel > _FAR_M and 0.0 < stiffness < _SOFT_N_PER_M:
        other, factor = "mm", 1e-3
    elif travel < _NEAR_M and stiffness > _HARD_N_PER_M:
        other, factor = "m", 1e3
    else:
        return None
    return (
        f"is the unit right? the position moves by {travel:.2g} m against"
        f" {float(f'{stiffness:.2g}'):g} N/m; read in {other} it would be {factor * travel:.2g} m"
        f" against {float(f'{stiffness / factor:.2g}'):g} N/m: if that is the object, say so with"
        f" --units position={other}"
    )


def _if_exchanged(recording: Recording, travel: float) -> str:
    """Return the advice for columns of each other's role, where free air or the travel shows it."""
    if (note := exchange_note(recording)) is not None:
        return f"; {note}"
    varies = float(np.ptp(recording.force))
    if varies >= travel:
        return ""
    return (
        f"; the force varies by {varies:.3g} {recording.units[1]} only: if the two columns are"
        f" exchanged, name them with {exchanged(recording.columns)}"
    )


def refuse_wrong_units(recording: Recording, stiffness: float | None) -> None:
    """Raise RecordingError if travel or stiffness of a linear rig suggests a wrong unit."""
    if recording.units[0] != "m":
        return
    travel = float(np.ptp(recording.position))
    if travel > _LONGEST_M:
        raise RecordingError(
            f"{recording.name}: wrong unit? the position moves by {travel:.3g} m; if it is in mm,"
            f" say so with --units position=mm{_if_exchanged(recording, travel)}"
        )
    stiffest, remedy = _STIFFEST_N_PER_M, _STATE_UNITS
    if recording.units_stated:
        stiffest, remedy = _STIFFEST_STATED_N_PER_M, ""
    if stiffness is not None and stiffness > stiffest:
        raise RecordingError(
            f"{recording.name}: wrong unit? a spring of {stiffness:.2g} N/m is stiffer than any"
            f" body that such a rig can press on; check the units of position and force{remedy}"
        )
