"""Diagnosis of one recording: load, base, residual, named effects, held-out error, as one dict."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.answers import outliers
from teleop_rt.diagnosis.answers.answer import base_entry, candidates_of, effects_of
from teleop_rt.diagnosis.answers.detectable import detectable
from teleop_rt.diagnosis.answers.errors import HeldOut, bounded_floor
from teleop_rt.diagnosis.answers.experiment import Reach, design
from teleop_rt.diagnosis.answers.instruments import by_reference
from teleop_rt.diagnosis.answers.notes import (
    notes_of,
    of_dropout,
    of_lost_contact,
    of_part,
    of_time,
)
from teleop_rt.diagnosis.answers.other_base import other_base
from teleop_rt.diagnosis.answers.residuals import nearest, of_nearest, predict_recording
from teleop_rt.diagnosis.answers.resonance import of_resonance
from teleop_rt.diagnosis.criteria import SECOND_SHARE
from teleop_rt.diagnosis.draft.choice import dependence
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.inference.confirmed import Judged, noise_of
from teleop_rt.diagnosis.inference.explanation import bounded_by_error, likelihoods
from teleop_rt.diagnosis.inference.rounds import INCONCLUSIVE, Diagnosis
from teleop_rt.diagnosis.inference.verdict import Verdict
from teleop_rt.diagnosis.inference.views import judged
from teleop_rt.diagnosis.models.base import base_of
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.noise.structure import pressed_all_along
from teleop_rt.diagnosis.phases import enter
from teleop_rt.diagnosis.samples.motion import resolution_step
from teleop_rt.diagnosis.samples.outliers import OUTLIERS
from teleop_rt.diagnosis.samples.preparation import lone_samples, pose_again
from teleop_rt.diagnosis.samples.smoothing import moves_in_steps
from teleop_rt.diagnosis.samples.turned_sign import turned_sign
from teleop_rt.recordings.excerpt import most_active
from teleop_rt.recordings.recording import Recording


def diagnose(
    recording: Recording,
    base: str = "kelvin-voigt",
    *,
    test: Recording | None = None,
    effects: tuple[Effect, ...] = LIBRARY,
    surface: float | None = None,
    reach: Reach | None = None,
) -> Diagnosis:
    """Return the effects that the base model lacks in the recording, with errors on unseen data.

    `base` is a model id or terms joined by commas. `surface` overrides the recording's own
    [rig unit]. `reach` limits the proposed motion that separates a class; by default it is that of
    the recording. The error is on `test` if given, else on held-out blocks. Raises
    RecordingError and ValueError with one clear message each.
    """
    begun = time.perf_counter()
    whole_s = recording.seconds
    recording, start = most_active(recording)
    enter("finding surface and motion")
    model = base_of(base)
    made = judged(recording, model, surface, effects)
    enter("error on held-out data")
    made, on_blocks = _bounded(made)
    weighed, found = made.weighed, made.found
    problem, model, judgement = found.problem, found.base.model.base, found.judgement
    answer = _answer(found, recording)
    errors = on_blocks if test is None else predicted_on(found, test, surface).errors
    answer["error"] = bounded_floor(errors)
    unseen = None if test is None else pose_again(test, model, surface, weighed.problem)
    if (estimated := by_reference(found.problem, found.best, recording, unseen)) is not None:
        answer["instruments"] = estimated
    if not moves_in_steps(recording.position, recording.force, recording.dt):
        # Each step may leave a lone sample.
        lone = lone_samples(recording, problem, found.base)
        outliers.add_to(answer, lone, recording.force, problem.motion)
    if judgement.verdict == "class":
        enter("choosing the motion that decides")
        proposed = design(weighed.problem, [r.fit for r in judgement.sets], reach)
        answer["experiment"] = proposed.entry() if proposed else None
        found = replace(found, experiment=proposed)
    if judgement.verdict == "unexplained":
        answer["nearest"] = nearest(found, test, surface)
        answer["error"] = bounded_floor(answer["error"], answer["nearest"] or {})
    answer["detectable"] = _detectable(weighed, recording, answer, effects)
    _add_notes(answer, made, recording, (base, surface), start)
    answer["part"] = {"from_s": round(start, 3), "length_s": round(recording.seconds, 3)}
    answer["notes"] += of_part(**answer["part"], whole_s=whole_s)
    answer["seconds"] = round(time.perf_counter() - begun, 3)
    return replace(found, answer=answer)


def _detectable(
    weighed: Diagnosis, recording: Recording, answer: dict[str, Any], effects: tuple[Effect, ...]
) -> list[dict[str, Any]]:
    """Return the detectable sizes of the effects that are not named."""
    problem, named = weighed.problem, {effect["name"] for effect in answer["effects"]}
    named = named.union(*answer["class"], answer["probability"])
    pressed = pressed_all_along(problem)
    library = applicable(effects, recording, weighed.base.model.base, pressed=pressed)
    step = resolution_step(recording.position, recording.dt)
    form_error = SECOND_SHARE * weighed.judgement.excess if weighed.best.names else 0.0
    sizes = detectable(
        problem, weighed.best, weighed.input_errors, library, recording.units, step, form_error
    )
    return [one for one in sizes if one["name"] not in named]


def _add_notes(
    answer: dict[str, Any],
    made: Judged,
    recording: Recording,
    stated: tuple[str, float | None],
    start: float,
) -> None:
    """Add the notes, the quantities behind the residual, and dropouts, which count as gaps.

    `stated` are the base and the surface that the caller gave; the recording's part that is used
    begins at `start` [s].
    """
    found, (base, surface) = made.found, stated
    if made.inconclusive:
        answer["dependence"] = dependence(found.problem, found.best)
        answer["notes"] += of_time(answer["dependence"])
    model = found.base.model.base
    hints = (
        turned_sign(found.problem, found.base.model, recording.columns),
        other_base(found),
        of_resonance(made.weighed.problem),
    )
    answer["notes"] += [hint for hint in hints if hint is not None]
    answer["notes"] += notes_of(answer, model, base, recording, surface, made.weighed.samples)
    answer["notes"] += of_nearest(found, answer)
    answer["notes"] += of_lost_contact(found.problem, found.predicts, recording, start)
    answer["notes"] += list(made.signs)
    times = [(start + n * recording.dt, start + m * recording.dt) for n, m in made.weighed.lost]
    answer["notes"] += [of_dropout(*pair) for pair in times]
    answer["gaps"]["count"] += len(made.weighed.lost)
    answer["gaps"]["samples"] += sum(past - first for first, past in made.weighed.lost)


def _in_air(found: Diagnosis) -> tuple[Fit, ...]:
    """Return the fits by which free air shows the noise, if something stays unexplained."""
    return (found.base, found.best) if found.judgement.verdict in INCONCLUSIVE else ()


def _bounded(made: Judged) -> tuple[Judged, dict[str, Any]]:
    """Return the judgement as its error on held-out blocks allows, and that error.

    Sets that were judged beside an unknown remainder have probabilities that know it.
    """
    found = replace(made.found, predicting=made.plain.base)
    # A perfect model leaves no more than the best one.
    left = found.left_by(found.predicts)
    noise = min(noise_of(made.weighed, _in_air(found)), left)
    errors = made.blocks.predicted(found.predicts, noise).errors
    if found.predictor is None:
        judgement = bounded_by_error(found.judgement, errors["after_over_floor"] or 1.0)
        found = replace(found, judgement=judgement)
    return replace(made, found=found), errors


def predicted_on(
    found: Diagnosis, test: Recording, surface: float | None = None, *, named: bool = False
) -> HeldOut:
    """Return the prediction of another recording by the base alone, and by the best model.

    The latter is the predictor, or that of the `named` effects: an extended model holds these and
    no other.
    """
    base, best = found.predicting or found.base, found.best if named else found.predicts
    return predict_recording(test, base, best, found.problem, surface, _in_air(found))


def narrowed(found: Diagnosis, recording: Recording, sets: list[list[str]]) -> Diagnosis:
    """Return the diagnosis where only these sets of its class are possible, the error as it was."""
    left = tuple(r for r in found.judgement.sets if list(r.fit.names) in sets)
    verdict: Verdict = "named" if len(left) == 1 else "class"
    found = replace(found, judgement=replace(found.judgement, verdict=verdict, sets=left))
    fresh = _answer(found, recording)
    answer = found.answer | {
        key: fresh[key] for key in ("verdict", "effects", "class", "base", "candidates")
    }
    for effect in found.answer["effects"]:
        if effect["name"] == OUTLIERS:
            outliers.join(answer, effect)
    return replace(found, answer=answer)


def _answer(found: Diagnosis, recording: Recording) -> dict[str, Any]:
    judgement = found.judgement
    return {
        "recording": recording.name,
        "base": base_entry(found.best, found.problem, found.input_errors, recording.units),
        "verdict": judgement.verdict,
        "effects": effects_of(found.problem, found.base, judgement, found.input_errors,
                              recording.units),
        "class": [list(r.fit.names) for r in judgement.sets],
        "family": judgement.family,
        "experiment": None,
        "nearest": None,
        "dependence": None,
        "draft": None,
        "detectable": [],
        "candidates": candidates_of(found.candidates, judgement),
        "probability": {
            name: round(p, 4)
            for name, p in (judgement.probability or likelihoods(judgement)).items()
        },
        "predictor": list(found.predicts.names),
        "notes": [],
        "error": {},
        "gaps": {"count": recording.gaps, "samples": recording.missing},
    }  # fmt: skip
