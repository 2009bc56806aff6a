"""The diagnosis where every set leaves more than noise: what is known beside what is not."""

from __future__ import annotations

from dataclasses import replace

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import EFFECT_COST, LOUD
from teleop_rt.diagnosis.inference.explanation import explain, predictor
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.rounds import Diagnosis, applicable
from teleop_rt.diagnosis.inference.sets import Scored, search_sets
from teleop_rt.diagnosis.inference.verdict import Judgement, Ranked
from teleop_rt.diagnosis.noise.structure import LackOfFit
from teleop_rt.diagnosis.recordings.recording import Recording


def leaves_the_unknown(weighed: Diagnosis, plain: Diagnosis, left: float, noise: float) -> bool:
    """Return whether a named set is to be judged beside something unknown.

    It stands, unless it predicts inner blocks no better than the base. Where it leaves more than
    fast noise (`left` against `noise`, deviations of the force), a second effect may only stand in
    for the form of the first, and slow noise for what nobody knows.
    """
    best = weighed.judgement.sets[0].fit
    if len(best.names) > 1 and left > LOUD * noise:
        return True
    return blind_energy(plain.problem, plain.best) >= blind_energy(plain.problem, plain.base)


def beside_the_unknown(
    plain: Diagnosis, recording: Recording, effects: tuple[Effect, ...]
) -> Diagnosis:
    """Return the diagnosis by sets of effects judged on inner blocks, and the set that predicts.

    `plain` has a problem in which all frequencies weigh alike: weights that follow the noise give
    up the force where an unknown thing is largest.
    """
    problem, base = plain.problem, plain.base
    tried = search_sets(problem, base, applicable(effects, recording, base.model.base))
    found = explain(tried)
    best = predictor(tried, {name for one in found.sets for name in one.names})
    scale = problem.whitener.effective / best.energy
    judgement = Judgement(
        found.verdict,
        tuple(_ranked(one, scale) for one in found.sets),
        found.family,
        base_energy(tried) * scale,
        probability=found.probability,
    )
    candidates = tuple(_ranked(one, scale) for one in tried if one.names)
    return replace(plain, judgement=judgement, candidates=candidates, predictor=best.fit)


def base_energy(tried: list[Scored]) -> float:
    """Return what the base alone leaves of inner blocks."""
    return tried[0].energies[0]


def _ranked(one: Scored, scale: float) -> Ranked:
    """Return a set as the rest of the answer knows it; energies count in those of the predictor."""
    gain = (one.energies[0] - one.energy) * scale
    left = LackOfFit(one.energy * scale, 0)
    return Ranked(one.fit, gain, gain - EFFECT_COST * len(one.names), left)
