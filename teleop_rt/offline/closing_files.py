"""Closing the loop over measured files: nothing moves, a second file is the fresh trial."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from teleop_rt.contact.effects.user import library
from teleop_rt.contact.models import MODELS
from teleop_rt.diagnosis.answers import extended
from teleop_rt.diagnosis.answers.errors import HeldOut
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
from teleop_rt.offline.write import KEPT, NOT_YET, Keep, ignore, write_diagnosis
from teleop_rt.recordings.recording import Recording, refuse_other_units


@dataclass(frozen=True)
class Files:
    """Two measured files of one machine: one to diagnose, and one for the errors."""

    recording: Path
    test: Path
    table: Table
    effects: Path | None = None


def close_recordings(
    files: Files, base: str, out: Path, keep: Keep = ignore
) -> tuple[dict[str, Any], Residuals]:
    """Return the effects that a recording's model lacks, and the errors on another recording.

    With it the residuals on the other recording; those of the first where nothing was added.
    `keep` gets the answer so far, before anything is written.

    The motion is past, so the felt force is not evaluated. Raises RecordingError.
    """
    measured, unseen = (load_any(file, files.table) for file in (files.recording, files.test))
    refuse_other_units(unseen, measured)
    found = diagnose(measured, base, test=unseen, effects=library(files.effects))
    return close_over(found, measured, unseen, files, out, keep)


def close_over(
    found: Diagnosis,
    measured: Recording,
    unseen: Recording,
    files: Files,
    out: Path,
    keep: Keep = ignore,
) -> tuple[dict[str, Any], Residuals]:
    """Return the same of a diagnosis that was made; `out` gets model, page and perhaps a draft."""
    result = found.answer
    keep(_of_diagnosis(result, files))
    named = predicted_on(found, unseen, named=True) if result["effects"] else None
    if named is not None:
        fresh = _fresh(named, found, result, files)
        keep(_of_diagnosis(result, files) | {"fresh": fresh})
    draft = write_draft(found, measured, out / "diagnosis", unseen, None, files.effects)
    write_diagnosis(found, measured, files.recording, out / "diagnosis")
    answer = _of_diagnosis(result, files)  # with the paths that were written
    if named is not None:
        predicted = named
    elif draft is not None:
        predicted = draft.predicted(unseen)
        result = {**result, "effects": [draft.effect], "base": draft.base,
                "error": predicted.shown_errors}  # fmt: skip
        fresh = _fresh(predicted, found, result, replace(files, effects=draft.file))
        answer["reason"] = DRAFTED
    else:
        answer["reason"] = ANSWERS.get(result["verdict"], "no effect was named")
        return answer, residuals_of(found, measured.units)
    model = out / "model.yaml"
    extended.write(model, result)
    left = residuals_on(predicted, unseen.units)
    return answer | {"fresh": fresh} | keep_or_withdraw(model, fresh), left


def _of_diagnosis(result: Mapping[str, Any], files: Files) -> dict[str, Any]:
    """Return the entries that a diagnosis alone gives."""
    answer = {"recording": str(files.recording), "test": str(files.test)}
    return answer | {key: result[key] for key in (*KEPT, "experiment")} | NOT_YET


def _fresh(
    predicted: HeldOut, found: Diagnosis, result: dict[str, Any], files: Files
) -> dict[str, Any]:
    """Return the errors on the test file with the effects of `result`."""
    base, document = found.base.model.base.name, extended.document(result)
    return {
        "changes": [],
        "slave": {
            "free_run": predicted.shown_errors,
            "on_line": _on_line(files.test, base, document, files.table, files.effects),
        },
        "master": _without_errors(
            "the recordings were made before: no hand has felt the extended model"
        ),
        "handled": handled(result, library(files.effects)),
    }


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
