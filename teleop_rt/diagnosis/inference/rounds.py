"""The judgement of a recording, once on all samples, and again without some that hide the rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from teleop_rt.contact.effect import WITHOUT_CONTACT, Effect
from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.answers.experiment import Experiment
from teleop_rt.diagnosis.answers.notes import Samples
from teleop_rt.diagnosis.criteria import LOUD
from teleop_rt.diagnosis.inference.pairs import alike
from teleop_rt.diagnosis.inference.ranking import Ranking, needed_pairs, weighed_errors
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.inference.verdict import Judgement, Ranked, joined, judge
from teleop_rt.diagnosis.inference.weighing import weigh_singles
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import input_errors, knowing_encoder, within_a_step
from teleop_rt.diagnosis.noise.noise_floor import fast_noise, noise_floor
from teleop_rt.diagnosis.noise.structure import lack_of_fit, noise_from, tangent_space
from teleop_rt.diagnosis.noise.whiten import Matrix
from teleop_rt.diagnosis.phases import enter
from teleop_rt.diagnosis.recordings.recording import Recording
from teleop_rt.diagnosis.samples import beginning, outliers, touches
from teleop_rt.diagnosis.samples.dropouts import Stretch, dropouts, without
from teleop_rt.diagnosis.samples.motion import Motion, resolution_step
from teleop_rt.diagnosis.samples.preparation import without_edges
from teleop_rt.diagnosis.samples.surface import refuse_wrong_units

_SLOW_NOISE = 0.1  # of the force's deviation; no sensor or amplifier of a rig wanders by more
_OPEN = ("partial", "unexplained")
_JITTERS = 0.02  # of a period; stamps that stray more may make a delay of their own
_SEEN, _TAKEN = 0.2, 0.95
_BY_DIRECTION = "backward_ratio"  # shape of friction by direction
_A_SURFACE_ELSEWHERE = {
    ("contact_offset", ""),
    ("backlash", "from the loading flank"),
    ("backlash", "from the unloading flank"),
}


@dataclass(frozen=True)
class Diagnosis:
    """Everything a diagnosis found; `answer` is ready for JSON.

    `predicting` is the base alone with the parameters by which it predicts best, `predictor` the
    set that predicts where it is not the one that explains; `samples` those that it rests on.
    """

    problem: Problem
    base: Fit
    judgement: Judgement
    candidates: tuple[Ranked, ...]
    input_errors: Matrix
    answer: dict[str, Any]
    experiment: Experiment | None = None
    predicting: Fit | None = None
    predictor: Fit | None = None
    samples: Samples = "usual"

    @property
    def best(self) -> Fit:
        """The base with the best set, or the base alone."""
        return self.judgement.sets[0].fit if self.judgement.sets else self.base

    @property
    def predicts(self) -> Fit:
        """The model whose errors are reported."""
        return self.predictor or self.best


def in_rounds(
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
        known = touches.explained_by_timing(weighed.problem, away.problem, away.best)
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
    enter("fitting the base")
    library = applicable(effects, recording, model)
    alone = fit_base(problem, model)
    problem = without_edges(problem, [alone.model.shift(alone.zeta)])
    fast, alone = problem, fit_base(problem, model, alone)
    refuse_wrong_units(recording, _stiffness(alone))
    errors = input_errors(problem.motion, recording)
    problem = knowing_encoder(problem, alone, errors)
    for _ in range(2):
        whitener = noise_from(problem, alone)
        problem = replace(problem, whitener=whitener)
        alone = fit_base(problem, model, alone)
    enter("trying single effects")
    problem, alone, singles = weigh_singles(problem, fast, alone, library)
    step = resolution_step(recording.position, recording.dt)
    own = tangent_space(problem, alone)
    alone = within_a_step(problem, alone, step, own)
    rank = Ranking(problem, alone, errors, step)
    left = lack_of_fit(problem, alone, own)
    ranked = [rank(fit) for fit in singles]
    enter("trying pairs of effects")
    pairs, ranked = needed_pairs(rank, left, ranked, library)
    weighed = weighed_errors(rank, ranked, pairs)
    judgement = judge(left, *weighed, rank.floor)
    if judgement.verdict == "no_missing_effect" and _is_loud(problem, alone, rank.rows):
        judgement = judge(left, *weighed, rank.floor, loud=True)
    likes = [alike(problem, ranking.fit, library) for ranking in judgement.sets]
    for other in (fit for fit in likes if fit is not None):
        judgement = joined(judgement, rank(other))
    candidates = tuple(sorted([*pairs, *ranked], key=lambda r: r.fit.bic))
    return Diagnosis(problem, alone, judgement, candidates, rank.rows, {}), errors


def _by_touches(found: Diagnosis, recording: Recording) -> bool:
    """Return whether an answer may rest on what a touch makes of filters and of late samples.

    It is open, or holds a delay where samples were not evenly taken, or its set explains what is
    loud by the weights of the noise and yet takes nothing off the plain error: a few samples have
    it all.
    """
    if found.judgement.verdict in _OPEN:
        return True
    if not found.judgement.sets:
        return False
    best, problem = found.judgement.sets[0], found.problem
    if recording.jitter > _JITTERS and any(e.family == "delay" for e in best.fit.model.effects):
        return True
    # Touches make no bias of the force, so a bias that is equal in both is not attributed to them.
    before, after = (held_out.deviation(problem, fit) for fit in (found.base, best.fit))
    return best.gain > _SEEN * problem.whitener.effective and after > _TAKEN * before


def _is_loud(problem: Problem, base: Fit, floor: Matrix) -> bool:
    """Return whether the base leaves far more than the noise that is taken to be in the recording.

    Slow noise hides what is slow; but no noise is louder than itself, and beyond the fastest no
    louder than `_SLOW_NOISE`.
    """
    where = held_out.counted(problem, base)
    force, left = (row[where > 0.0] for row in
                   (problem.force, problem.force - held_out.predict(problem, base)))  # fmt: skip
    if not left.size:
        return False
    slow = max(_SLOW_NOISE * float(np.std(force)), LOUD * fast_noise(problem, base, floor))
    noise = min(slow, LOUD * noise_floor(problem, base, floor, where, (base,)))
    return bool(np.sqrt(np.mean(left**2)) > noise)


def _stiffness(fit: Fit) -> float | None:
    """Return the linear stiffness, if the base has one."""
    if fit.model.base.has_power:
        return None
    names = [linear.name for linear in fit.model.linear]
    return float(fit.theta[names.index("k")]) if "k" in names else None


def applicable(effects: tuple[Effect, ...], recording: Recording, base: Base) -> tuple[Effect, ...]:
    """Leave out what cannot be: a lever's gravity on a linear rig, a material in free motion.

    A body that is held all along has laws of its own. Outliers have a test of their own;
    an offset of the surface is the base's own where it has to find the surface, and so is the flank
    from which a play is counted. Friction that differs by direction is even friction and a bias, so
    a base that has a bias needs no such law: nothing but a rest separates the two.
    """
    rotary = recording.units[0] == "rad"

    def possible(effect: Effect) -> bool:
        if effect.name == outliers.NAME or (effect.name == "gravity_torque" and not rotary):
            return False
        if base.finds_surface and (effect.name, effect.law) in _A_SURFACE_ELSEWHERE:
            return False
        if base.has_bias and any(shape.name == _BY_DIRECTION for shape in effect.shapes):
            return False
        if effect.law == WITHOUT_CONTACT:
            return not base.touches
        material = effect.belongs_to == "environment" or effect.only_in_contact
        return base.touches or not (material or effect.acts == "deflects")

    return tuple(effect for effect in effects if possible(effect))
