"""Closing the loop over measured files: nothing moves, a second file is the fresh trial."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from teleop_rt.contact.effects.user import library
from teleop_rt.contact.models import MODELS
from teleop_rt.diagnosis.answers import extended
from teleop_rt.diagnosis.answers.residuals import Residuals, residuals_of, residuals_on
from teleop_rt.diagnosis.diagnose import diagnose, predicted_on
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.extension import extension_from
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt.offline.closing import ANSWERS, DRAFTED, handled
from teleop_rt.offline.drafting import write_draft
from teleop_rt.offline.load import load_any
from teleop_rt.offline.replay import Choice, online_of
from teleop_rt.offline.table import Table
from teleop_rt.offline.withdrawal import keep_or_withdraw
from teleop_rt.offline.write import write_diagnosis
from teleop_rt.recordings.recording import Recording, refuse_other_units

KEPT = (
    *("base", "verdict", "effects", "class", "family"),
    *("probability", "nearest", "dependence", "draft", "experiment"),
)
"""Keys of a diagnosis' answer that the answer of a closed loop has, too."""


@dataclass(frozen=True)
class Files:
    """Two measured files of one machine: one to diagnose, and one for the errors."""

    recording: Path
    test: Path
    table: Table
    effects: Path | None = None


def close_recordings(files: Files, base: str, out: Path) -> tuple[dict[str, Any], Residuals]:
    """Return the effects that a recording's model lacks, and the errors on another recording.

    With it the residuals on the other recording; those of the first where nothing was added.

    The motion is past, so the felt force is not evaluated. Raises RecordingError.
    """
    measured, unseen = (load_any(file, files.table) for file in (files.recording, files.test))
    refuse_other_units(unseen, measured)
    found = diagnose(measured, base, test=unseen, effects=library(files.effects))
    return close_over(found, measured, unseen, files, out)


def close_over(
    found: Diagnosis, measured: Recording, unseen: Recording, files: Files, out: Path
) -> tuple[dict[str, Any], Residuals]:
    """Return the same of a diagnosis that was made; `out` gets model, page and perhaps a draft."""
    recording, test, table, effects = files.recording, files.test, files.table, files.effects
    base, known = found.base.model.base.name, library(effects)
    draft = write_draft(found, measured, out / "diagnosis", unseen, None, effects)
    write_diagnosis(found, measured, recording, out / "diagnosis")
    result = found.answer
    answer: dict[str, Any] = {"recording": str(recording), "test": str(test)}
    answer |= {key: result[key] for key in KEPT}
    answer |= {"extended_model": None, "withdrawn": None, "fresh": None}
    if result["effects"]:
        predicted = predicted_on(found, unseen, named=True)
    elif draft is not None:
        predicted = draft.predicted(unseen)
        result = {**result, "effects": [draft.effect], "base": draft.base,
                "error": predicted.shown_errors}  # fmt: skip
        known, effects = library(draft.file), draft.file
        answer["reason"] = DRAFTED
    else:
        answer["reason"] = ANSWERS.get(result["verdict"], "no effect was named")
        return answer, residuals_of(found, measured.units)
    model = out / "model.yaml"
    extended.write(model, result)
    document = extended.document(result)
    fresh = {
        "changes": [],
        "slave": {
            "free_run": predicted.shown_errors,
            "on_line": _on_line(test, base, document, table, effects),
        },
        "master": _without_errors(
            "the recordings were made before: no hand has felt the extended model"
        ),
        "handled": handled(result, known),
    }
    left = residuals_on(predicted, unseen.units)
    return answer | {"fresh": fresh} | keep_or_withdraw(model, fresh), left


def _without_errors(reason: str) -> dict[str, Any]:
    return {"metric": "nrmse", "before": None, "after": None, "reason": reason}


def _on_line(
    test: Path, base: str, document: dict[str, Any], table: Table, effects: Path | None
) -> dict[str, Any]:
    """Return the open-loop errors of the estimators over the test file, without and with."""
    if base not in MODELS:
        return _without_errors(f"the base {base} does not run on-line")
    rows = rows_for([base], ["direct"], ["rls"])
    extension = extension_from("extended model", document, str(effects) if effects else None)
    try:
        choice = Choice(models=[base], regressions=["direct"], solvers=["rls"])
        online = online_of(test, choice, table)
        alone = Pipeline(rows, online.settings)
        extended_too = Pipeline(extension.rows(rows), extension.settings(online.settings))
    except (ValueError, RecordingError) as error:  # too slow for their filters, or no contact
        return _without_errors(f"the estimators do not run on it: {error}")
    errors = []
    for pipeline in (alone, extended_too):
        pipeline.run(online.position, online.force, online.valid)
        errors.append(pipeline.nrmse(0))
    return {"metric": "nrmse", "before": errors[0], "after": errors[1]}
