"""The judgement of a recording on all samples, and again without dropouts, touches or beginning."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Effect, Matrix
from teleop_rt.diagnosis.answers.experiment import Experiment
from teleop_rt.diagnosis.criteria import EXCESS_NOISE_RATIO, REDRAWN_NOISE_RATIO
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.inference.needed import needed_sets
from teleop_rt.diagnosis.inference.one_more import alike
from teleop_rt.diagnosis.inference.ranked import Ranked, leaves_structure
from teleop_rt.diagnosis.inference.ranking import Ranking, weighed_errors
from teleop_rt.diagnosis.inference.search import fit_base
from teleop_rt.diagnosis.inference.verdict import Judgement, joined, judge
from teleop_rt.diagnosis.inference.weighing import weigh_singles, with_noise_of
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.base import Base
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.encoder import input_errors, knowing_encoder, within_a_step
from teleop_rt.diagnosis.noise.noise_floor import NoiseLevels
from teleop_rt.diagnosis.noise.structure import (
    LackOfFit,
    lack_of_fit,
    noise_from,
    pressed_all_along,
    tangent_space,
)
from teleop_rt.diagnosis.phases import enter
from teleop_rt.diagnosis.samples import beginning, touches
from teleop_rt.diagnosis.samples.dropouts import dropouts, without
from teleop_rt.diagnosis.samples.implausible import refuse_wrong_units
from teleop_rt.diagnosis.samples.motion import RecordedMotion, resolution_step
from teleop_rt.diagnosis.samples.preparation import Samples, without_edges, without_lone_samples
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import Stretch

INCONCLUSIVE = ("partial", "unexplained")
_UNEVEN_STAMPS = 0.02  # of a period; larger jitter of the stamps may look like a delay
_AGAIN = 6  # evaluations of a descent by another noise, from the optimum by the first one
_PAST_BOUND = 1.1  # times the bound, beyond which only a gap can have led the surface
_BEYOND_GAP = 2.0  # times the distance of a surface beyond its bound
_CLEAR_GAIN = 0.2  # chi-square per independent value: a gain that the unweighted residual must show
_UNREDUCED_RATIO = 0.95  # of the base's residual; a larger one is not reduced


@dataclass(frozen=True)
class Diagnosis:
    """The result of a diagnosis; `answer` is ready for JSON.

    `predicting` is the base alone with the parameters that predict best, `predictor` the set that
    predicts if another set explains, `samples` the choice of samples that the judgement uses.
    `errors` are motions with encoder errors, `input_errors` the whitened errors that they cause of
    the base's force, and `lost` the dropouts of the force sensor.
    """

    problem: Problem
    base: Fit
    judgement: Judgement
    candidates: tuple[Ranked, ...]
    errors: list[RecordedMotion]
    input_errors: Matrix
    answer: dict[str, Any]
    experiment: Experiment | None = None
    predicting: Fit | None = None
    predictor: Fit | None = None
    samples: Samples = "usual"
    lost: Sequence[Stretch] = ()

    @property
    def best(self) -> Fit:
        """The base with the best set, or the base alone."""
        return self.judgement.sets[0].fit if self.judgement.sets else self.base

    @property
    def predicts(self) -> Fit:
        """The model whose errors are reported."""
        return self.predictor or self.best

    def left_by(self, fit: Fit) -> float:
        """Return the root mean square of a fit's residual [rig's force]."""
        where = held_out.counted(self.problem, self.base) > 0.0
        return float(np.sqrt(self.problem.mean_square(fit, where)))

    def noise_levels(self, fit: Fit) -> NoiseLevels:
        """Return the levels of noise that a fit may leave as its residual."""
        where = held_out.counted(self.problem, fit)
        return NoiseLevels(self.problem, fit, self.input_errors, where)


def in_rounds(
    posed: Callable[..., tuple[Problem, Base]],
    recording: Recording,
    effects: tuple[Effect, ...],
) -> Diagnosis:
    """Return the judgement of all samples, or of those on which it can rest.

    Dropouts are left out first. If the verdict may rest on touches, these are left out as well. If
    nothing is missing and the recording starts in contact, its beginning is included when its
    residual is larger than that of the rest.
    """
    problem, model = posed()
    weighed = _judged(problem, model, recording, effects)
    if lost := dropouts(weighed.problem, weighed.best):
        problem = without(problem, lost)
        weighed = replace(_judged(problem, model, recording, effects), lost=lost)
    verdict = weighed.judgement.verdict
    if model.touches and _may_rest_on_touches(weighed, recording):
        away = _judged(touches.spared(problem), model, recording, effects)
        known = touches.explained_by_timing(weighed.problem, away.problem, away.best)
        if known and away.judgement.verdict not in INCONCLUSIVE:
            return replace(away, samples="away from touches", lost=lost)
    if model.touches and verdict == "no_missing_effect":
        whole = without(posed(fresh=True)[0], lost)
        if beginning.misfits(whole, weighed.problem, weighed.base):
            from_start = _judged(whole, model, recording, effects)
            if _complete(from_start.judgement):
                return replace(from_start, samples="from the start", lost=lost)
            weighed = replace(weighed, samples="without an odd beginning")
    return weighed


def _judged(
    problem: Problem, model: Base, recording: Recording, effects: tuple[Effect, ...]
) -> Diagnosis:
    """Return the judgement with its noise model."""
    enter("fitting the base")
    library = applicable(effects, recording, model, pressed=pressed_all_along(problem))
    alone = fit_base(problem, model)
    if (further := _beyond_onset(problem, alone)) is not None:
        problem, alone = further, fit_base(further, model, alone)
    problem = without_edges(problem, [alone.model.shift(alone.zeta)])
    problem = without_lone_samples(recording, problem, alone)
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
    rank, left, alone = _ranking(problem, alone, errors, step)
    ranked = [rank(fit) for fit in singles]
    enter("trying sets of effects")
    sets, ranked = needed_sets(rank, left, ranked, library)
    if (quieter := _quieter(problem, alone, ranked, sets, library)) is not None:
        problem, alone, singles = quieter
        rank, left, alone = _ranking(problem, alone, errors, step)
        ranked = [rank(fit) for fit in singles]
        sets = [rank(problem.refine(r.fit.model, r.fit.zeta, _AGAIN)) for r in sets]
        best = min(sets, key=lambda r: r.fit.bic)
        if len(best.fit.names) > 2 or leaves_structure(best.left, rank.floor):
            sets, ranked = needed_sets(rank, left, ranked, library)
    weighed = weighed_errors(rank, ranked, sets)
    judgement = judge(left, *weighed, rank.floor)
    if judgement.verdict == "no_missing_effect" and _exceeds_noise(problem, alone, rank.rows):
        judgement = judge(left, *weighed, rank.floor, exceeds_noise=True)
    likes = [alike(problem, alone, ranking.fit, library) for ranking in judgement.sets]
    for other in (fit for fit in likes if fit is not None):
        judgement = joined(judgement, rank(other))
    candidates = tuple(sorted([*sets, *ranked], key=lambda r: r.fit.bic))
    return Diagnosis(problem, alone, judgement, candidates, errors, rank.rows, {})


def _beyond_onset(problem: Problem, alone: Fit) -> Problem | None:
    """Return the problem with a wider bound of the surface if the base has it beyond its bound.

    The surface is sought in the nearest gaps between samples, which a quick touch crosses in one:
    the onset is no better known than the gaps are wide. At its bound a surface stays.
    """
    if not alone.model.base.finds_surface:
        return None
    shift, scales = abs(alone.model.shift(alone.zeta)), problem.motion.scales
    if shift <= _PAST_BOUND * scales["onset"]:
        return None
    wider = {**scales, "onset": _BEYOND_GAP * shift}
    return replace(problem, motion=replace(problem.motion, scales=wider))


def _ranking(
    problem: Problem, alone: Fit, errors: list[RecordedMotion], step: float
) -> tuple[Ranking, LackOfFit, Fit]:
    """Return the ranking against the base alone, its lack of fit, and the base within a step."""
    own = tangent_space(problem, alone)
    alone = within_a_step(problem, alone, step, own)
    return Ranking(problem, alone, errors, step), lack_of_fit(problem, alone, own), alone


def _quieter(
    problem: Problem,
    alone: Fit,
    singles: list[Ranked],
    sets: list[Ranked],
    library: tuple[Effect, ...],
) -> tuple[Problem, Fit, list[Fit]] | None:
    """Return problem, base and single effects with the noise of the likeliest set.

    None without a set, or if its noise is hardly less.
    """
    if not sets:
        return None
    best = min(sets, key=lambda r: r.fit.bic)
    return with_noise_of(problem, alone, [r.fit for r in singles], library, best.fit)


def _complete(judgement: Judgement) -> bool:
    """Return whether the best set leaves noise alone.

    One beginning is a single event, of which any two effects explain most.
    """
    named = judgement.verdict in {"named", "class"}
    return named and not leaves_structure(judgement.sets[0].left, judgement.floor)


def _may_rest_on_touches(found: Diagnosis, recording: Recording) -> bool:
    """Return whether a verdict may rest on filters and late samples at the touches.

    It may if the verdict is inconclusive and the likeliest candidate leaves more at the touches
    than elsewhere, if the set contains a delay although the samples were unevenly taken, or if the
    set gains much whitened energy without reducing the unweighted residual: a few samples then hold
    all the evidence.
    """
    if found.judgement.verdict in INCONCLUSIVE:
        fits = [found.base, *(ranked.fit for ranked in found.candidates)]
        return touches.leaves_more(found.problem, min(fits, key=lambda fit: fit.bic))
    if not found.judgement.sets:
        return False
    best, problem = found.judgement.sets[0], found.problem
    if recording.jitter > _UNEVEN_STAMPS and any(
        e.family == "delay" for e in best.fit.model.effects
    ):
        return True
    # Touches cause no bias of the force, so the residual is compared without its mean.
    before, after = (held_out.deviation(problem, fit) for fit in (found.base, best.fit))
    return (
        best.gain > _CLEAR_GAIN * problem.whitener.effective and after > _UNREDUCED_RATIO * before
    )


def _exceeds_noise(problem: Problem, base: Fit, floor: Matrix) -> bool:
    """Return whether the base's residual is far larger than any noise of this recording.

    Noise that free air shows is noise whatever its share of the force.
    """
    where = held_out.counted(problem, base)
    if not np.any(where > 0.0):
        return False
    left = float(np.sqrt(problem.mean_square(base, where > 0.0)))
    noise = NoiseLevels(problem, base, floor, where)
    most = EXCESS_NOISE_RATIO * noise.bounded(noise.quick)
    return left > max(most, REDRAWN_NOISE_RATIO * noise.in_air)


def _stiffness(fit: Fit) -> float | None:
    """Return the linear stiffness, if the base has one."""
    if fit.model.base.has_power:
        return None
    names = [linear.name for linear in fit.model.linear]
    return float(fit.theta[names.index("k")]) if "k" in names else None
