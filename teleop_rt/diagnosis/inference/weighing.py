"""Single effects and the noise they leave, found together: each needs the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.answers.held_out import predict
from teleop_rt.diagnosis.criteria import CERTAIN_BIC
from teleop_rt.diagnosis.inference.pairs import glance_at_pairs
from teleop_rt.diagnosis.inference.search import (
    best_by_name,
    fit_base,
    glance,
    polished,
    search_singles,
)
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.structure import noise_from
from teleop_rt.diagnosis.samples.preparation import without_edges, without_impacts

_RED = 3.0  # times the fastest noise's power, from which the slow part may hide an effect
_BY_LOUDNESS = 3  # candidates found under white weights that are tried as well
_TRIED = 5  # of the best candidates, each with a noise of its own
_ROUNDS = 3  # in which noise and effects are found by turns, at most
_STILL_FALLING = 0.8  # of the noise's power; less is a further round worth
_NEAR = 0.2  # of the base's misfit, from the best; only such are polished


def weigh_singles(
    problem: Problem, fast: Problem, alone: Fit, library: tuple[Effect, ...]
) -> tuple[Problem, Fit, list[Fit]]:
    """Return the problem with its final noise, the base and the single effects weighed by it.

    `fast` has white noise as loud as the fastest part of the recording's. Where the noise looks
    red it may be noise, or an effect that nothing has caught; then effects, and pairs of them,
    are also sought as if it were white, and the likeliest candidate decides.
    """
    singles, loud = search_singles(problem, alone, library), list[Fit]()
    if _looks_red(problem, fast):
        loud = glance(fast, fit_base(fast, alone.model.base, alone), library, _BY_LOUDNESS)
        singles = best_by_name([*singles, *(problem.solve(f.model, f.zeta, f.theta) for f in loud)])
    if not singles:
        return problem, alone, singles
    if alone.model.base.finds_surface:
        shifts = [fit.model.shift(fit.zeta) for fit in singles[:_TRIED]]
        problem, fast = without_edges(problem, shifts), without_edges(fast, shifts)
    problem, fast = (without_impacts(one, singles) for one in (problem, fast))
    problem, alone, singles = _with_settled_noise(problem, alone, singles, loud)
    if _looks_red(problem, fast) and alone.bic - singles[0].bic > CERTAIN_BIC:
        fits = (alone, *singles[:_BY_LOUDNESS])
        base, *louder = [fast.solve(f.model, f.zeta, f.theta) for f in fits]
        pairs = glance_at_pairs(fast, base, louder, library)[:_BY_LOUDNESS]
        problem, alone, singles = _with_better_noise(problem, alone, singles, pairs)
    return problem, alone, singles


def _with_settled_noise(
    problem: Problem, alone: Fit, singles: list[Fit], loud: Sequence[Fit]
) -> tuple[Problem, Fit, list[Fit]]:
    """Take the noise that the likeliest candidate leaves until it falls no more.

    Weights that hold what the base leaves for noise also hold a candidate off its optimum, so the
    noise that it leaves at first is not yet the noise.
    """
    for _ in range(_ROUNDS):
        before = float(np.mean(problem.whitener.density))
        problem, alone, singles = _with_better_noise(problem, alone, singles, loud)
        if float(np.mean(problem.whitener.density)) > _STILL_FALLING * before:
            break
        fresh = noise_from(problem, singles[0])
        if np.mean(fresh.density) > _STILL_FALLING * np.mean(problem.whitener.density):
            break
    return problem, alone, singles


def _looks_red(problem: Problem, fast: Problem) -> bool:
    """Return whether the noise is far above the level of its fastest part."""
    whole, quick = problem.whitener.density, fast.whitener.density
    return float(np.mean(whole)) > _RED * float(np.mean(quick))


def _as_it_stands(problem: Problem, fit: Fit) -> Fit:
    """Return a fit of other weights in the problem's, with its parameters, also the linear ones.

    Solved by weights that hold what it explains for noise, it would explain little of it.
    """
    found = problem.solve(fit.model, fit.zeta, fit.theta)
    left = problem.whitener(problem.force - predict(problem, fit))
    return replace(found, theta=fit.theta, residual=left)


def _with_better_noise(
    problem: Problem, base: Fit, singles: list[Fit], others: Sequence[Fit]
) -> tuple[Problem, Fit, list[Fit]]:
    """Take the noise that the likeliest candidate leaves, each with a noise of its own.

    All fits are then weighed by that noise. Of the `others`, pairs only lend theirs; where a single
    effect does, it is a candidate from where it stands: in a noise that holds what it explains,
    another place looks better.
    """
    found = [_as_it_stands(problem, fit) for fit in others]
    tried = [base, *singles[:_TRIED], *found]
    whiteners = [noise_from(problem, fit) for fit in tried]

    def score(place: int) -> float:
        # Whittle: log density for every value, for the residual over density is 1 on average.
        penalty = tried[place].model.size * float(np.log(base.effective))
        return base.effective * float(np.mean(np.log(whiteners[place].density))) + penalty

    best = min(range(len(tried)), key=score)
    problem = replace(problem, whitener=whiteners[best])
    base = polished(problem, problem.refine(base.model, base.zeta, 6))
    likely = singles[:_TRIED]
    if best >= len(tried) - len(found) and len(tried[best].names) == 1:
        likely.append(tried[best])
    again = [problem.refine(fit.model, fit.zeta, 6) for fit in likely]
    least = min(fit.chi2 for fit in again)
    near = least + _NEAR * (base.chi2 - least)
    again = [polished(problem, fit) if fit.chi2 < near else fit for fit in again]
    again += [problem.solve(fit.model, fit.zeta, fit.theta) for fit in singles[_TRIED:]]
    return problem, base, best_by_name(again)
