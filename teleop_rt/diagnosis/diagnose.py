"""Diagnosis of one recording: load, base, residual, named effects, held-out error, as one dict."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.diagnosis import beginning, held_out, outliers, touches, whiten
from teleop_rt.diagnosis.answer import effects_of, parameters_of_base
from teleop_rt.diagnosis.base import Base, base_of
from teleop_rt.diagnosis.dropouts import Stretch, dropouts, without
from teleop_rt.diagnosis.encoder import input_errors, input_floor, knowing_encoder, within_a_step
from teleop_rt.diagnosis.errors import HeldOut, errors_of, on_blocks, on_record
from teleop_rt.diagnosis.excerpt import most_telling
from teleop_rt.diagnosis.experiment import Experiment, Reach, design
from teleop_rt.diagnosis.fit import Fit, Problem
from teleop_rt.diagnosis.instruments import by_reference
from teleop_rt.diagnosis.motion import Motion, force_noise, resolution_step
from teleop_rt.diagnosis.noise_floor import noise_floor, with_own_noise
from teleop_rt.diagnosis.notes import Samples, notes_of, of_dropout
from teleop_rt.diagnosis.pairs import alike
from teleop_rt.diagnosis.preparation import pose, pose_again, without_edges
from teleop_rt.diagnosis.ranking import Ranking, needed_pairs, weighed_errors
from teleop_rt.diagnosis.recording import Recording
from teleop_rt.diagnosis.saturated import basis
from teleop_rt.diagnosis.search import fit_base
from teleop_rt.diagnosis.structure import Flexible, lack_of_fit, noise_from, tangent_space
from teleop_rt.diagnosis.surface import refuse_wrong_units
from teleop_rt.diagnosis.verdict import (
    Judgement,
    Ranked,
    Verdict,
    joined,
    judge,
    something_left,
    too_loud,
)
from teleop_rt.diagnosis.weighing import weigh_singles
from teleop_rt.diagnosis.whiten import Matrix

_LOUD = 2.0
_OPEN = ("partial", "unexplained")
_JITTERS = 0.02
_WORSE = 1.3


@dataclass(frozen=True)
class Diagnosis:
    """Everything a diagnosis found; `answer` is ready for JSON.

    `predicting` is the base alone with the parameters by which it predicts best; `samples` those
    that it rests on.
    """

    problem: Problem
    base: Fit
    judgement: Judgement
    candidates: tuple[Ranked, ...]
    input_errors: Matrix
    answer: dict[str, Any]
    experiment: Experiment | None = None
    predicting: Fit | None = None
    samples: Samples = "usual"

    @property
    def best(self) -> Fit:
        """The base with the best set, or the base alone."""
        return self.judgement.sets[0].fit if self.judgement.sets else self.base


def diagnose(
    recording: Recording,
    base: str = "kelvin-voigt",
    *,
    test: Recording | None = None,
    effects: tuple[Effect, ...] = LIBRARY,
    surface: float | None = None,
    reach: Reach | None = None,
) -> Diagnosis:
    """Return what the base model leaves unexplained in the recording, and the error with it.

    `base` is a model id or terms joined by commas. `surface` overrides the recording's own
    [rig unit]. `reach` is what the rig may do, for the motion that tells a class apart; what the
    recording shows, unless told. Error is on `test` if given, else on held-out blocks. Raises
    RecordingError and ValueError with one clear message each.
    """
    begun = time.perf_counter()
    recording, start = most_telling(recording)
    posed = partial(pose, recording, base_of(base), surface)
    weighed, errors, lost = _in_rounds(posed, recording, effects)
    problem, model, judgement = weighed.problem, weighed.base.model.base, weighed.judgement
    plain = weighed if judgement.verdict == "no_missing_effect" else _plainly(weighed, errors)
    found = replace(plain if _predicts_worse(weighed, plain) else weighed, predicting=plain.base)
    answer = _answer(found, recording)
    if test is None:
        answer["error"] = errors_of(_on_blocks(weighed, plain, found), problem.motion.dt)
    else:
        answer["error"] = errors_on(found, test, surface)
    unseen = None if test is None else pose_again(test, model, surface, weighed.problem)
    if (told := by_reference(found.problem, found.best, recording, unseen)) is not None:
        answer["instruments"] = told
    lone = outliers.isolated(recording.force, problem.motion.x, force_noise(recording.force))
    outliers.add_to(answer, lone, problem.motion)
    if judgement.verdict == "class":
        proposed = design(weighed.problem, [r.fit for r in judgement.sets], reach)
        answer["experiment"] = proposed.entry() if proposed else None
        found = replace(found, experiment=proposed)
    answer["gaps"]["count"] += len(lost)
    answer["gaps"]["samples"] += sum(past - first for first, past in lost)
    answer["notes"] = notes_of(answer, model, recording, surface, weighed.samples)
    answer["notes"] += [of_dropout(start + n * recording.dt, start + m * recording.dt)
                        for n, m in lost]  # fmt: skip
    answer["part"] = {"from_s": round(start, 3), "length_s": round(recording.seconds, 3)}
    answer["seconds"] = round(time.perf_counter() - begun, 3)
    return replace(found, answer=answer)


def _in_rounds(
    posed: Callable[..., tuple[Problem, Base]], recording: Recording, effects: tuple[Effect, ...]
) -> tuple[Diagnosis, list[Motion], list[Stretch]]:
    """Return the judgement on the samples that can be used, and where the sensor dropped out.

    Without such stretches; then, where something stays open, without the touches; and where nothing
    is missing, with the beginning of a recording that starts in contact, should it stand out.
    """
    problem, model = posed()
    weighed, errors = _weighed(problem, model, recording, effects)
    if lost := dropouts(weighed.problem, weighed.best):
        problem = without(problem, lost)
        weighed, errors = _weighed(problem, model, recording, effects)
    verdict = weighed.judgement.verdict
    if model.touches and _by_touches(weighed, recording):
        away, again = _weighed(touches.spared(problem), model, recording, effects)
        known = touches.tell_no_more(weighed.problem, away.problem, away.best)
        if known and away.judgement.verdict not in _OPEN:
            return replace(away, samples="away from touches"), again, lost
    if model.touches and verdict == "no_missing_effect":
        whole = without(posed(fresh=True)[0], lost)
        if beginning.stands_out(whole, weighed.problem, weighed.base):
            from_start, again = _weighed(whole, model, recording, effects)
            if from_start.judgement.verdict in {"named", "class"}:
                return replace(from_start, samples="from the start"), again, lost
            weighed = replace(weighed, samples="without an odd beginning")
    return weighed, errors, lost


def _weighed(
    problem: Problem, model: Base, recording: Recording, effects: tuple[Effect, ...]
) -> tuple[Diagnosis, list[Motion]]:
    """Return the judgement with the noise that it rests on, and the encoder's errors."""
    library = applicable(effects, recording, model)
    rows = basis(problem.motion)
    alone = fit_base(problem, model)
    problem = without_edges(problem, [alone.model.shift(alone.zeta)])
    fast, alone = problem, fit_base(problem, model, alone)
    refuse_wrong_units(recording, _stiffness(alone))
    errors = input_errors(problem.motion, recording)
    problem = knowing_encoder(problem, alone, errors)
    for _ in range(2):
        whitener = noise_from(problem, alone, Flexible(problem.whitener, rows))
        problem = replace(problem, whitener=whitener)
        alone = fit_base(problem, model, alone)
    problem, alone, singles = weigh_singles(problem, fast, alone, library, rows)
    step = resolution_step(recording.position, recording.dt)
    own = tangent_space(problem, alone)
    alone = within_a_step(problem, alone, step, own)
    rank = Ranking(problem, alone, Flexible(problem.whitener, rows), errors, step)
    left = lack_of_fit(problem, alone, rank.flexible, own)
    ranked = [rank(fit) for fit in singles]
    pairs, ranked = needed_pairs(rank, left, ranked, library)
    weighed = weighed_errors(rank, ranked, pairs)
    judgement = judge(left, *weighed, rank.floor)
    if judgement.verdict == "no_missing_effect" and _is_loud(problem, alone, rank.rows):
        judgement = judge(left, *weighed, rank.floor, loud=True)
    likes = [alike(problem, ranking.fit, library) for ranking in judgement.sets]
    for other in (fit for fit in likes if fit is not None):
        judgement = joined(judgement, rank(other))
    if judgement.sets:
        judgement = too_loud(
            judgement, *(held_out.loudness(problem, fit) for fit in (alone, judgement.sets[0].fit))
        )
    candidates = tuple(sorted([*pairs, *ranked], key=lambda r: r.fit.bic))
    return Diagnosis(problem, alone, judgement, candidates, rank.rows, {}), errors


def _by_touches(found: Diagnosis, recording: Recording) -> bool:
    """Tell whether an answer may rest on what a touch makes of filters and of late samples.

    It is open, or holds a delay where samples were not evenly taken.
    """
    if found.judgement.verdict in _OPEN:
        return True
    effects = [effect for r in found.judgement.sets[:1] for effect in r.fit.model.effects]
    return recording.jitter > _JITTERS and any(effect.family == "delay" for effect in effects)


def _is_loud(problem: Problem, base: Fit, floor: Matrix) -> bool:
    """Tell whether the base leaves far more than the noise that is taken to be in the recording.

    Slow noise hides what is slow; but no noise is louder than itself.
    """
    where = held_out.counted(problem, base)
    left = (problem.force - held_out.predict(problem, base))[where > 0.0]
    noise = noise_floor(problem, base, floor, where)
    return bool(left.size and np.sqrt(np.mean(left**2)) > _LOUD * noise)


def _stiffness(fit: Fit) -> float | None:
    """Return the linear stiffness, if the base has one."""
    if fit.model.base.has_power:
        return None
    names = [linear.name for linear in fit.model.linear]
    return float(fit.theta[names.index("k")]) if "k" in names else None


def applicable(effects: tuple[Effect, ...], recording: Recording, base: Base) -> tuple[Effect, ...]:
    """Leave out what cannot be: a lever's gravity on a linear rig, a material in free motion.

    Outliers have a test of their own; an offset of the surface is the base's own where it has to
    find the surface.
    """
    rotary = recording.units[0] == "rad"

    def possible(effect: Effect) -> bool:
        if effect.name == outliers.NAME or (effect.name == "gravity_torque" and not rotary):
            return False
        if effect.name == "contact_offset" and base.finds_surface:
            return False
        material = effect.belongs_to == "environment" or effect.only_in_contact
        return base.touches or not (material or effect.acts == "deflects")

    return tuple(effect for effect in effects if possible(effect))


def _plainly(found: Diagnosis, errors: list[Motion]) -> Diagnosis:
    """Return the diagnosis with every frequency of the force weighing alike.

    What leaves structure is fitted so, for where a model is wrong, weights that follow the noise
    give up the force where it is largest.
    """
    problem = found.problem
    where = held_out.counted(problem, found.base) > 0.0
    rest = (problem.force - held_out.predict(problem, found.best))[where]
    deviation = max(float(np.std(rest)), 1e-9 * problem.motion.scales["force"])
    problem = replace(
        problem, whitener=whiten.white(problem.whitener.mask, deviation, problem.motion.dt)
    )
    base = problem.refine(found.base.model, found.base.zeta)
    judgement = found.judgement
    if judgement.sets:
        best = judgement.sets[0]
        fit = problem.refine(best.fit.model, best.fit.zeta)
        judgement = replace(judgement, sets=(replace(best, fit=fit), *judgement.sets[1:]))
    floor_rows = input_floor(problem, base, errors)
    return replace(found, problem=problem, base=base, judgement=judgement, input_errors=floor_rows)


def _predicts_worse(weighed: Diagnosis, plain: Diagnosis) -> bool:
    """Tell whether weights that follow the noise make a worse model than weights that are alike.

    Where structure is left they do, and where they leave clearly more, for they took what is slow
    to be noise.
    """
    if not weighed.judgement.sets:
        return True
    best = weighed.judgement.sets[0]
    if something_left(best.left, weighed.judgement.floor):
        return True
    problem, where = weighed.problem, held_out.counted(weighed.problem, weighed.base) > 0.0
    left = [
        float(np.sum((problem.force - held_out.predict(problem, one.best))[where] ** 2))
        for one in (weighed, plain)
    ]
    return left[0] > _WORSE**2 * left[1]


def _in_air(found: Diagnosis) -> tuple[Fit, ...]:
    """Return the fits by which free air tells the noise: where something stays unexplained."""
    unexplained = found.judgement.verdict in {"partial", "unexplained"}
    return (found.base, found.best) if unexplained else ()


def _on_blocks(weighed: Diagnosis, plain: Diagnosis, found: Diagnosis) -> HeldOut:
    """Return the held-out blocks of the recording itself."""
    problem, best = weighed.problem, weighed.best
    where = held_out.counted(problem, weighed.base)
    noise = noise_floor(problem, best, weighed.input_errors, where, _in_air(weighed))
    return on_blocks(plain.problem, found.problem, plain.base, found.best, noise)


def errors_on(found: Diagnosis, test: Recording, surface: float | None = None) -> dict[str, Any]:
    """Return the answer's `error` of the base alone and of the best model on another recording."""
    fresh, rows = with_own_noise(
        pose_again(test, found.best.model.base, surface, found.problem), found.best, test
    )
    where = held_out.counted(fresh, found.best)
    noise = noise_floor(fresh, found.best, rows, where, _in_air(found))
    return errors_of(on_record(fresh, found.predicting or found.base, found.best, noise),
                     fresh.motion.dt)  # fmt: skip


def narrowed(found: Diagnosis, recording: Recording, sets: list[list[str]]) -> Diagnosis:
    """Return the diagnosis where only these sets of its class are possible, the error as it was."""
    left = tuple(r for r in found.judgement.sets if list(r.fit.names) in sets)
    verdict: Verdict = "named" if len(left) == 1 else "class"
    found = replace(found, judgement=replace(found.judgement, verdict=verdict, sets=left))
    told = _answer(found, recording)
    answer = found.answer | {key: told[key] for key in ("verdict", "effects", "class", "base")}
    for effect in found.answer["effects"]:
        if effect["name"] == outliers.NAME:
            outliers.join(answer, effect)
    return replace(found, answer=answer)


def _answer(found: Diagnosis, recording: Recording) -> dict[str, Any]:
    judgement = found.judgement
    return {
        "recording": recording.name,
        "base": {
            "model": found.base.model.base.name,
            "parameters": parameters_of_base(found.best, found.problem, found.input_errors,
                                              recording.units),
        },
        "verdict": judgement.verdict,
        "effects": effects_of(found.problem, found.base, judgement, found.input_errors,
                              recording.units),
        "class": [list(r.fit.names) for r in judgement.sets]
        if judgement.verdict in {"named", "class"} else [],
        "family": judgement.family,
        "experiment": None,
        "error": {},
        "gaps": {"count": recording.gaps, "samples": recording.missing},
    }  # fmt: skip
