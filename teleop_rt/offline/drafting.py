"""The draft of a law that a diagnosis leaves beside its page, where the vocabulary has no word."""

from __future__ import annotations

from pathlib import Path

from teleop_rt.diagnosis.answers.errors import bounded_floor
from teleop_rt.diagnosis.answers.residuals import residuals_of
from teleop_rt.diagnosis.draft.declaration import FILE
from teleop_rt.diagnosis.draft.drafted import Drafted, drafted
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.recordings.recording import Recording

PICTURE = "draft_effect.png"
_OPEN = ("partial", "unexplained")


def write_draft(
    found: Diagnosis,
    recording: Recording,
    folder: Path,
    test: Recording | None = None,
    surface: float | None = None,
    own: Path | None = None,
) -> Drafted | None:
    """Write draft_effect.py and its picture into the folder where something stays unexplained.

    The answer's `draft` describes it: None if nothing is left or no law was found. Its errors are
    those on `test`, or on held-out blocks; `own` is the user's file of effects.
    """
    for name in (FILE, PICTURE):  # of another diagnosis
        (folder / name).unlink(missing_ok=True)
    if found.answer["verdict"] not in _OPEN:
        return None
    draft = drafted(found, recording, folder, own)
    if draft is None:
        return None
    entry = draft.entry(test, surface)
    found.answer["draft"] = entry
    found.answer["error"] = bounded_floor(found.answer["error"], entry["error"])
    try:
        from teleop_rt.view.residual_figure import (  # noqa: PLC0415 - an extra may be absent
            residual_figure,
        )
    except ImportError:
        return draft
    left = residuals_of(found, recording.units, draft.fit)
    residual_figure(left).savefig(folder / PICTURE, dpi=110)
    return draft
