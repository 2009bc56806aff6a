"""Diagnosis of one recording: load, base, residual, named effects, held-out error, as one dict."""

from __future__ import annotations

import time
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis.answers import outliers
from teleop_rt.diagnosis.answers.answer import base_entry, candidates_of, effects_of
from teleop_rt.diagnosis.answers.detectable import detectable
from teleop_rt.diagnosis.answers.errors import HeldOut, errors_of, on_blocks
from teleop_rt.diagnosis.answers.experiment import Reach, design
from teleop_rt.diagnosis.answers.instruments import by_reference
from teleop_rt.diagnosis.answers.notes import notes_of, of_dropout, of_time
from teleop_rt.diagnosis.answers.other_base import other_base
from teleop_rt.diagnosis.answers.residuals import Unseen, nearest, predict_recording
from teleop_rt.diagnosis.criteria import REDRAWN_NOISE_RATIO
from teleop_rt.diagnosis.draft.choice import dependence
from teleop_rt.diagnosis.inference.discrepancy import (
    judge_with_unknown_remainder,
    needs_unknown_remainder,
)
from teleop_rt.diagnosis.inference.explanation import likelihoods
from teleop_rt.diagnosis.inference.rounds import INCONCLUSIVE, Diagnosis, applicable, in_rounds
from teleop_rt.diagnosis.inference.unweighted import confirmed_unweighted
from teleop_rt.diagnosis.inference.verdict import Verdict, leaves_structure
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.base import Base, base_of
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.noise.encoder import input_floor
from teleop_rt.diagnosis.noise.noise_floor import known_noise, largest_noise, noise_floor
from teleop_rt.diagnosis.noise.structure import pressed_all_along
from teleop_rt.diagnosis.phases import enter
from teleop_rt.diagnosis.recordings.excerpt import most_active
from teleop_rt.diagnosis.recordings.recording import Recording
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.diagnosis.samples.onset import Surface
from teleop_rt.diagnosis.samples.preparation import pose, pose_again
from teleop_rt.diagnosis.samples.rows import OUTLIERS, Stretch, force_noise
from teleop_rt.diagnosis.samples.rows import outliers as isolated
from teleop_rt.diagnosis.samples.smoothing import moves_in_steps
from teleop_rt.diagnosis.samples.surface import surface_behind_weight
from teleop_rt.diagnosis.samples.turned_sign import turned_sign


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
    recording, start = most_active(recording)
    enter("finding surface and motion")
    model = base_of(base)
    weighed, found, plain, lost = _judged(recording, model, surface, effects)
    known = surface is not None or recording.surface is not None or not model.touches
    if found.judgement.verdict in INCONCLUSIVE and not known:
        hidden = surface_behind_weight(recording)
        other = None if hidden is None else _judged(recording, model, hidden, effects)
        if other is not None and other[1].judgement.verdict not in INCONCLUSIVE:
            weighed, found, plain, lost = other
    problem, model, judgement = found.problem, found.base.model.base, found.judgement
    found = replace(found, predicting=plain.base)
    answer = _answer(found, recording)
    enter("error on held-out data")
    if test is None:
        answer["error"] = errors_of(_on_blocks(weighed, plain, found), problem.motion.dt)
    else:
        answer["error"] = errors_on(found, test, surface)
    unseen = None if test is None else pose_again(test, model, surface, weighed.problem)
    if (estimated := by_reference(found.problem, found.best, recording, unseen)) is not None:
        answer["instruments"] = estimated
    if not moves_in_steps(
        recording.position, recording.force, recording.dt
    ):  # each may leave a lone sample
        noise = force_noise(recording.force, recording.force_step)
        lone = isolated(recording.force, problem.motion.x, noise, recording.dt)
        outliers.add_to(answer, lone, problem.motion)
    if judgement.verdict == "class":
        enter("choosing the motion that decides")
        proposed = design(weighed.problem, [r.fit for r in judgement.sets], reach)
        answer["experiment"] = proposed.entry() if proposed else None
        found = replace(found, experiment=proposed)
    answer["gaps"]["count"] += len(lost)
    answer["gaps"]["samples"] += sum(past - first for first, past in lost)
    if judgement.verdict == "unexplained":
        answer["nearest"] = nearest(found, test, surface)
    if judgement.verdict in {"partial", "unexplained"}:
        answer["dependence"] = dependence(problem, found.best)
        answer["notes"] += of_time(answer["dependence"])
    named = {effect["name"] for effect in answer["effects"]}.union(*answer["class"])
    pressed = pressed_all_along(weighed.problem)
    library = applicable(effects, recording, model, pressed=pressed)
    answer["detectable"] = [
        one
        for one in detectable(weighed.problem, weighed.base, weighed.input_errors, library,
                              recording.units)
        if one["name"] not in named
    ]  # fmt: skip
    hints = (turned_sign(found.problem, found.base.model), other_base(found))
    answer["notes"] += [hint for hint in hints if hint is not None]
    answer["notes"] += notes_of(answer, model, base, recording, surface, weighed.samples)
    answer["notes"] += [of_dropout(start + n * recording.dt, start + m * recording.dt)
                        for n, m in lost]  # fmt: skip
    answer["part"] = {"from_s": round(start, 3), "length_s": round(recording.seconds, 3)}
    answer["seconds"] = round(time.perf_counter() - begun, 3)
    return replace(found, answer=answer)


def _judged(
    recording: Recording, base: Base, surface: float | Surface | None, effects: tuple[Effect, ...]
) -> tuple[Diagnosis, Diagnosis, Diagnosis, list[Stretch]]:
    """Return the judgement, the confirmed one, the unweighted one, and dropouts of the force."""
    posed = partial(pose, recording, base, surface)
    weighed, errors, lost = in_rounds(posed, recording, effects)
    if weighed.judgement.verdict == "no_missing_effect":
        return weighed, weighed, weighed, lost
    enter("confirming by an unweighted fit")
    return weighed, *_confirmed(weighed, errors, recording, effects), lost


def _unweighted(found: Diagnosis, errors: list[RecordedMotion]) -> Diagnosis:
    """Return the diagnosis with equal weight on all frequencies of the force.

    A model that leaves structure is fitted with these weights: weights that follow the noise would
    ignore the force at frequencies where the model's error is largest.
    """
    problem = found.problem
    deviation = max(_root_mean_square(found, found.best), 1e-9 * problem.motion.scales["force"])
    problem = replace(problem, whitener=problem.whitener.evenly(deviation))
    base = problem.refine(found.base.model, found.base.zeta)
    judgement = found.judgement
    if judgement.sets:
        best = judgement.sets[0]
        fit = problem.refine(best.fit.model, best.fit.zeta)
        # Of the fits before: compared fits must share their weights.
        chances = judgement.probability or likelihoods(judgement)
        sets = (replace(best, fit=fit), *judgement.sets[1:])
        judgement = replace(judgement, sets=sets, probability=chances)
    floor_rows = input_floor(problem, base, errors)
    return replace(found, problem=problem, base=base, judgement=judgement, input_errors=floor_rows)


def _confirmed(
    weighed: Diagnosis,
    errors: list[RecordedMotion],
    recording: Recording,
    effects: tuple[Effect, ...],
) -> tuple[Diagnosis, Diagnosis]:
    """Return the diagnosis that an unweighted fit confirms, and the unweighted one.

    A named set is kept if its residual is noise, or small against that of the base. Otherwise sets
    of effects are judged with an unknown remainder.
    """
    plain = _unweighted(weighed, errors)
    if weighed.judgement.sets and weighed.judgement.verdict != "partial":
        noise, in_air = _noise(weighed, ()), _noise(weighed, (weighed.base, weighed.best))
        judgement = confirmed_unweighted(
            weighed.judgement, plain.problem, plain.base, noise, in_air
        )
        if judgement is not weighed.judgement:
            weighed = replace(weighed, judgement=judgement)
            plain = _unweighted(weighed, errors)
        where = held_out.counted(weighed.problem, weighed.best)
        most = largest_noise(weighed.problem, weighed.best, weighed.input_errors, where)
        known = known_noise(weighed.problem, weighed.best, weighed.input_errors, where)
        left = _root_mean_square(plain, plain.best)
        if judgement.verdict != "partial" and not needs_unknown_remainder(plain, left, known, most):
            return (plain if _predicts_worse(weighed, plain) else weighed), plain
    found = judge_with_unknown_remainder(plain, recording, effects, errors)
    return found, found


def _root_mean_square(found: Diagnosis, fit: Fit) -> float:
    """Return the root mean square of a fit's residual [rig's force]."""
    where = held_out.counted(found.problem, found.base) > 0.0
    rest = (found.problem.force - held_out.predict(found.problem, fit))[where]
    return float(np.sqrt(np.mean(rest**2)))


def _predicts_worse(weighed: Diagnosis, plain: Diagnosis) -> bool:
    """Return whether weights that follow the noise give a worse model than equal weights.

    They do if structure is left, or if their residual is clearly larger: they then treated a slow
    force as noise.
    """
    if leaves_structure(weighed.judgement.sets[0].left, weighed.judgement.floor):
        return True
    before, after = (_root_mean_square(one, one.best) for one in (weighed, plain))
    return before > REDRAWN_NOISE_RATIO * after


def _in_air(found: Diagnosis) -> tuple[Fit, ...]:
    """Return the fits by which free air shows the noise, if something stays unexplained."""
    unexplained = found.judgement.verdict in {"partial", "unexplained"}
    return (found.base, found.best) if unexplained else ()


def _on_blocks(weighed: Diagnosis, plain: Diagnosis, found: Diagnosis) -> HeldOut:
    """Return the held-out blocks of the recording itself."""
    # A perfect model leaves no more than the best one.
    noise = min(_noise(weighed, _in_air(found)), _root_mean_square(found, found.predicts))
    return on_blocks(plain.problem, found.problem, plain.base, found.predicts, noise)


def _noise(weighed: Diagnosis, in_air: tuple[Fit, ...]) -> float:
    """Return the standard deviation of what noise alone leaves of the recording's force.

    For fits `in_air` see `noise_floor`.
    """
    problem, best = weighed.problem, weighed.best
    where = held_out.counted(problem, weighed.base)
    return noise_floor(problem, best, weighed.input_errors, where, in_air)


def errors_on(found: Diagnosis, test: Recording, surface: float | None = None) -> dict[str, Any]:
    """Return the answer's `error` of the base alone and of the best model on another recording."""
    return _predicted(found, test, surface).errors


def errors_of_named(
    found: Diagnosis, test: Recording, surface: float | None = None
) -> dict[str, Any]:
    """Return the same of the named effects alone: an extended model holds these and no other."""
    return named_on(found, test, surface).errors


def named_on(found: Diagnosis, test: Recording, surface: float | None = None) -> Unseen:
    """Return the prediction of another recording by the base, and by the named effects with it."""
    return _predicted(replace(found, predictor=None), test, surface)


def _predicted(found: Diagnosis, test: Recording, surface: float | None) -> Unseen:
    base = found.predicting or found.base
    return predict_recording(test, base, found.predicts, found.problem, surface, _in_air(found))


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
