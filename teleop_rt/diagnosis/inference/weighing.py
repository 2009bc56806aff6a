"""Joint estimation of single effects and the noise in their residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.criteria import CERTAIN_BIC
from teleop_rt.diagnosis.inference.laws import by_other_laws, extended
from teleop_rt.diagnosis.inference.one_more import (
    MOST_EFFECTS,
    coarse_one_more,
    worth_extending,
)
from teleop_rt.diagnosis.inference.polishing import polished
from teleop_rt.diagnosis.inference.search import (
    best_by_name,
    search_singles,
)
from teleop_rt.diagnosis.inference.unsupported import at_wrong_bound
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.structure import noise_from
from teleop_rt.diagnosis.samples.preparation import without_edges, without_impacts, without_start

_RED_NOISE_RATIO = 3.0  # times the fastest noise's power; redder noise may contain an effect
_SLOW_NOISE_RATIO, _SLOW_PART = 10.0, 50  # the same, of the slowest fiftieth of the band alone
_WHITE_FITS = 3  # candidates found with white noise that are tried as well
_NOISE_CANDIDATES = 5  # of the best candidates, each with a noise of its own
_NOISE_ROUNDS = 3  # alternations of noise and effects, at most
_FALLING_POWER_RATIO = 0.8  # of the previous noise power; a larger fall starts another round
_POLISHED_SHARE = 0.2  # of the base's gain; only fits within it of the best are polished


def weigh_singles(
    problem: Problem, fast: Problem, alone: Fit, library: tuple[Effect, ...]
) -> tuple[Problem, Fit, list[Fit]]:
    """Return the problem with its final noise, the base and the single effects weighed by it.

    `fast` is the problem with white noise at the level of the recording's fastest noise. If the
    estimated noise is red, it may contain an effect that no candidate explained. Sets of two to
    four are then searched with white noise as well, and the likeliest candidate determines the
    noise.
    """
    singles = search_singles(problem, alone, library)
    if not singles:
        return problem, alone, singles
    if at_wrong_bound(problem, singles[0]):
        # Fitted beside the surface of another law, it ends where that compensates for it.
        singles = best_by_name([*singles, *by_other_laws(problem, singles[0], library)])
    if alone.model.base.finds_surface:
        shifts = [fit.model.shift(fit.zeta) for fit in singles[:_NOISE_CANDIDATES]]
        problem, fast = without_edges(problem, shifts), without_edges(fast, shifts)
    plausible = worth_extending(alone, singles)
    problem, fast = (
        without_start(without_impacts(one, plausible), singles[0]) for one in (problem, fast)
    )
    problem, alone, singles = _with_settled_noise(problem, alone, singles, library)
    if _looks_red(problem, fast) and alone.bic - singles[0].bic > CERTAIN_BIC:
        fits = (alone, *singles[:_WHITE_FITS])
        base, *louder = [fast.solve(f.model, f.zeta, f.theta) for f in fits]
        for number in range(2, MOST_EFFECTS + 1):
            before = float(np.mean(problem.whitener.density))
            larger = coarse_one_more(fast, base, louder, library)[:_WHITE_FITS]
            problem, alone, singles = _with_better_noise(problem, alone, singles, library, larger)
            falls = np.mean(problem.whitener.density) < _FALLING_POWER_RATIO * before
            if not larger or not _looks_red(problem, fast) or (number > 2 and not falls):
                break
            louder = [fast.solve(f.model, f.zeta, f.theta) for f in larger]
    return problem, alone, singles


def with_noise_of(
    problem: Problem, alone: Fit, singles: list[Fit], library: tuple[Effect, ...], best: Fit
) -> tuple[Problem, Fit, list[Fit]] | None:
    """Return problem, base and single effects with the noise of a set, None if it is no less."""
    fresh = noise_from(problem, best)
    if np.mean(fresh.density) > _FALLING_POWER_RATIO * np.mean(problem.whitener.density):
        return None
    return _with_better_noise(problem, alone, singles, library, [best])


def _with_settled_noise(
    problem: Problem, alone: Fit, singles: list[Fit], library: tuple[Effect, ...]
) -> tuple[Problem, Fit, list[Fit]]:
    """Estimate the noise from the likeliest candidate's residual until its power stops falling.

    Weights that treat the base's residual as noise keep a candidate away from its optimum, so the
    first estimate is too large.
    """
    for _ in range(_NOISE_ROUNDS):
        before = float(np.mean(problem.whitener.density))
        problem, alone, singles = _with_better_noise(problem, alone, singles, library)
        if float(np.mean(problem.whitener.density)) > _FALLING_POWER_RATIO * before:
            break
        fresh = noise_from(problem, singles[0])
        if np.mean(fresh.density) > _FALLING_POWER_RATIO * np.mean(problem.whitener.density):
            break
    return problem, alone, singles


def _looks_red(problem: Problem, fast: Problem) -> bool:
    """Return whether the noise, or its slow part, is far above the level of its fastest part.

    The part caused by the encoder's errors is known, and holds no effect.
    """
    whole, quick = problem.whitener, float(np.mean(fast.whitener.density))
    unknown = np.maximum(whole.density - whole.known, 0.0)
    slow = unknown[: max(3, whole.bins // _SLOW_PART)]
    return (
        float(np.mean(unknown)) > _RED_NOISE_RATIO * quick
        or float(np.mean(slow)) > _SLOW_NOISE_RATIO * quick
    )


def _with_own_parameters(problem: Problem, fit: Fit) -> Fit:
    """Return a fit with its own linear parameters, whitened by the problem's weights.

    Weights that treat the force of its effect as noise would reduce the effect if it were solved
    again.
    """
    found = problem.solve(fit.model, fit.zeta, fit.theta)
    left = problem.whitener(problem.residual(fit))
    return replace(found, theta=fit.theta, residual=left)


def _with_better_noise(
    problem: Problem,
    base: Fit,
    singles: list[Fit],
    library: tuple[Effect, ...],
    sets: Sequence[Fit] = (),
) -> tuple[Problem, Fit, list[Fit]]:
    """Return problem, base and single effects with the noise of the likeliest candidate.

    Each candidate's likelihood uses the noise from its own residual. The `sets` only provide that
    noise. Louder noise may have hidden an extension of the likeliest effect's law: that a friction
    differs by direction is a slow force.
    """
    found = [_with_own_parameters(problem, fit) for fit in sets]
    tried = [base, *singles[:_NOISE_CANDIDATES], *found]
    whiteners = [noise_from(problem, fit) for fit in tried]

    def score(place: int) -> float:
        # Whittle: log density for every value, for the residual over density is 1 on average.
        penalty = tried[place].model.size * float(np.log(base.effective))
        return base.effective * float(np.mean(np.log(whiteners[place].density))) + penalty

    best = min(range(len(tried)), key=score)
    problem = replace(problem, whitener=whiteners[best])
    base = polished(problem, problem.refine(base.model, base.zeta, 6))
    again = [problem.refine(fit.model, fit.zeta, 6) for fit in singles[:_NOISE_CANDIDATES]]
    least = min(fit.chi2 for fit in again)
    near = least + _POLISHED_SHARE * (base.chi2 - least)
    again = [polished(problem, fit) if fit.chi2 < near else fit for fit in again]
    again += extended(problem, min(again, key=lambda fit: fit.bic), library)
    again += [problem.solve(fit.model, fit.zeta, fit.theta) for fit in singles[_NOISE_CANDIDATES:]]
    return problem, base, best_by_name(again)
