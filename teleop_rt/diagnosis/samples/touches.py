"""Samples around each touch and release, where filters and timing of the channels dominate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.samples.preparation import without_edges
from teleop_rt.recordings.filters import running_rank

_TOUCH_MARGIN_S = 0.02  # s around a touch: a filter of 50 Hz spreads a jump over it
_KEPT_SHARE = 0.5  # of the samples; if fewer are left, too little is known
_UNEXPLAINED_SHARE = 0.05  # of the residual energy at touches; timing explains a smaller rest


def spared(problem: Problem) -> Problem:
    """Return the problem without 20 ms around each touch and release.

    The force jumps there. Filters in both channels, or samples taken a little late, spread that
    jump; no effect of body or rig describes this, and it may exceed the effects to be found.
    """
    return replace(
        problem, settling=max(problem.settling, round(_TOUCH_MARGIN_S / problem.motion.dt))
    )


def leaves_more(problem: Problem, fit: Fit) -> bool:
    """Return whether a fit's mean squared residual is larger at the touches than elsewhere.

    If it is not, the touches are no obstacle to any law.
    """
    used = problem.whitener.mask > 0.0
    away = without_edges(spared(problem), [fit.model.shift(fit.zeta)]).whitener.mask > 0.0
    squares = problem.residual(fit) ** 2
    if np.all(used == away) or not np.any(away):
        return False
    return bool(np.mean(squares[used & ~away]) > np.mean(squares[away]))


def explained_by_timing(whole: Problem, away: Problem, fit: Fit) -> bool:
    """Return whether the residual about the touches can be explained by timing alone.

    `whole` counts the samples there and `away` does not. Averages and delays of the channels only
    produce forces between those that the model predicts nearby; adhesion produces others. Enough
    samples must be left elsewhere.
    """
    counted, kept = whole.whitener.mask > 0.0, away.whitener.mask > 0.0
    if np.count_nonzero(kept) < _KEPT_SHARE * np.count_nonzero(counted):
        return False
    hidden = counted & ~kept
    predicted = fit.force_on(away.motion)
    width = 2 * away.settling + 1
    least = running_rank(predicted, width, 0.0)
    most = running_rank(predicted, width, 1.0)
    noise = SIGMAS * float(np.std((away.force - predicted)[kept]))
    beyond = np.maximum(least - noise - away.force, away.force - most - noise).clip(min=0.0)
    left = np.abs(away.force - predicted)
    return float(np.sum(beyond[hidden] ** 2)) <= _UNEXPLAINED_SHARE * float(
        np.sum(left[hidden] ** 2)
    )
