"""Single effects and the noise they leave, found together: each needs the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from teleop_rt.contact.effect import Effect
from teleop_rt.diagnosis.fit import Fit, Problem
from teleop_rt.diagnosis.pairs import search_pairs
from teleop_rt.diagnosis.search import best_by_name, fit_base, search_singles
from teleop_rt.diagnosis.structure import Flexible, noise_from
from teleop_rt.diagnosis.verdict import CERTAIN_BIC
from teleop_rt.diagnosis.whiten import Matrix

_RED = 3.0
_BY_LOUDNESS = 3
_TRIED = 5


def weigh_singles(
    problem: Problem, fast: Problem, alone: Fit, library: tuple[Effect, ...], rows: Matrix
) -> tuple[Problem, Fit, list[Fit]]:
    """Return the problem with its final noise, the base and the single effects weighed by it.

    `fast` has white noise as loud as the fastest part of the recording's. Where the noise looks
    red it may be noise, or an effect that nothing has caught; then effects, and pairs of them,
    are also sought as if it were white, and the likeliest candidate decides.
    """
    singles = search_singles(problem, alone, library)
    if _looks_red(problem, fast):
        loud = search_singles(fast, fit_base(fast, alone.model.base), library)[:_BY_LOUDNESS]
        singles = best_by_name([*singles, *(problem.solve(f.model, f.zeta, f.theta) for f in loud)])
    if not singles:
        return problem, alone, singles
    problem, alone, singles = _with_better_noise(problem, alone, singles, rows)
    if _looks_red(problem, fast) and alone.bic - singles[0].bic > CERTAIN_BIC:
        louder = [fast.solve(f.model, f.zeta, f.theta) for f in singles[:_BY_LOUDNESS]]
        pairs = search_pairs(fast, louder, library)[:_BY_LOUDNESS]
        problem, alone, singles = _with_better_noise(problem, alone, singles, rows, pairs)
    return problem, alone, singles


def _looks_red(problem: Problem, fast: Problem) -> bool:
    """Tell whether the noise is far above what its fastest part tells."""
    whole, quick = problem.whitener.density, fast.whitener.density
    return float(np.mean(whole)) > _RED * float(np.mean(quick))


def _with_better_noise(
    problem: Problem, base: Fit, singles: list[Fit], rows: Matrix, pairs: Sequence[Fit] = ()
) -> tuple[Problem, Fit, list[Fit]]:
    """Take the noise that the likeliest candidate leaves, each with a noise of its own.

    All fits are then weighed by that noise. `pairs` only lend theirs.
    """
    flexible = Flexible(problem.whitener, rows)
    found = [problem.solve(fit.model, fit.zeta, fit.theta) for fit in pairs]
    tried = [base, *singles[:_TRIED], *found]
    whiteners = [noise_from(problem, fit, flexible) for fit in tried]

    def score(place: int) -> float:
        # Whittle: twice the sum of log density, for the residual over density is 1 on average.
        penalty = tried[place].model.size * float(np.log(base.effective))
        return 2.0 * float(np.sum(np.log(whiteners[place].density))) + penalty

    best = min(range(len(tried)), key=score)
    problem = replace(problem, whitener=whiteners[best])
    again = [problem.refine(fit.model, fit.zeta, 6) for fit in singles[:_TRIED]]
    again += [problem.solve(fit.model, fit.zeta, fit.theta) for fit in singles[_TRIED:]]
    base = problem.solve(base.model, base.zeta, base.theta)
    return problem, base, sorted(again, key=lambda fit: fit.bic)
