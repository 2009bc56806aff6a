"""The diagnosis if every set leaves more than noise: effects beside an unknown remainder."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import (
    EFFECT_COST,
    EXCESS_NOISE_RATIO,
    NOISE_POWER_DOUBT,
    SECOND_SHARE,
)
from teleop_rt.diagnosis.inference.applicable import applicable
from teleop_rt.diagnosis.inference.explanation import explain, predictor
from teleop_rt.diagnosis.inference.inner_blocks import blind_energy
from teleop_rt.diagnosis.inference.one_more import fit_without
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.inference.sets import Scored, search_sets
from teleop_rt.diagnosis.inference.verdict import Judgement
from teleop_rt.diagnosis.noise.encoder import input_floor
from teleop_rt.diagnosis.noise.noise_floor import NoiseLevels
from teleop_rt.diagnosis.noise.structure import LackOfFit, pressed_all_along
from teleop_rt.recordings.recording import Recording

_LARGEST_LEFT = 0.2  # of the base's energy above noise; another form of a law leaves less


def needs_unknown_remainder(plain: Diagnosis, left: float, known: float, noise: float) -> bool:
    """Return whether a named set must be judged again with an unknown remainder.

    It must if it leaves more than `_LARGEST_LEFT` of the base's energy on inner blocks and more
    than `noise`. It also must if it has two or more effects, its residual is larger than the
    `known` noise, that of the fastest differences or of free air (`left`, `known` and `noise` are
    deviations of the force), and it leaves more than the form error of any law: a noise of free
    colour may have absorbed a force that the laws do not describe; or a delay explains less than
    that: it moves the force of the other laws, and so stands in for the error of their form.
    """
    problem, best = plain.problem, plain.best
    before, after = (blind_energy(problem, fit) for fit in (plain.base, best))
    if left > EXCESS_NOISE_RATIO * known and len(best.names) > 1:
        form = SECOND_SHARE * before
        delays = [i for i, effect in enumerate(best.model.effects) if effect.family == "delay"]
        parts = (fit_without(problem, best, member) for member in delays)
        if after > form or any(blind_energy(problem, part) < after + form for part in parts):
            return True
    before, after = before - noise**2, after - noise**2
    return after >= before or after > max(_LARGEST_LEFT * before, NOISE_POWER_DOUBT * noise**2)


def judge_with_unknown_remainder(
    plain: Diagnosis, recording: Recording, effects: tuple[Effect, ...]
) -> Diagnosis:
    """Return the diagnosis by sets of effects that are judged on inner blocks, and the predictor.

    The problem of `plain` weights all frequencies equally: weights that follow the noise would
    ignore the force at frequencies where the unknown remainder is largest.
    """
    problem, base = plain.problem, plain.base
    pressed = pressed_all_along(problem)
    library = applicable(effects, recording, base.model.base, pressed=pressed)
    tried = search_sets(problem, base, library)
    # No set explains the force that encoder errors cause through it.
    rows = input_floor(problem, tried[0].fit, plain.errors)
    noise = NoiseLevels(problem, tried[0].fit, rows, problem.whitener.mask).lawless

    def apart(one: Scored, other: Scored) -> float:
        first, second = (each.fit.force_on(problem.motion) for each in (one, other))
        return float(np.mean((first - second)[problem.whitener.mask > 0.0] ** 2))

    found = explain(tried, noise**2, apart)
    best = predictor(tried, {name for one in found.sets for name in one.names})
    scale = problem.whitener.effective / best.energy
    judgement = Judgement(
        found.verdict,
        tuple(_ranked(one, scale) for one in found.sets),
        found.family,
        tried[0].energies[0] * scale,  # the base alone
        probability=found.probability,
    )
    candidates = tuple(_ranked(one, scale) for one in tried if one.names)
    return replace(plain, judgement=judgement, candidates=candidates, predictor=best.fit)


def _ranked(one: Scored, scale: float) -> Ranked:
    """Return a set as `Ranked`; energies are scaled so that the predictor leaves noise alone."""
    gain = (one.energies[0] - one.energy) * scale
    left = LackOfFit(one.energy * scale, 0)
    return Ranked(one.fit, gain, gain - EFFECT_COST * len(one.names), left)
