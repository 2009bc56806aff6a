"""Samples about each touch and release, where filters and clocks of the channels decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy

from teleop_rt.diagnosis.answers.held_out import predict
from teleop_rt.diagnosis.criteria import SIGMAS
from teleop_rt.diagnosis.models.fit import Fit, Problem

_ABOUT_S = 0.02  # s about a touch: what filters of 50 Hz make of a jump
_FEWEST = 0.5  # of the samples must be left elsewhere
_BEYOND = 0.05  # of what is left there; less is a matter of time


def spared(problem: Problem) -> Problem:
    """Return the problem that leaves out 20 ms about each touch and release.

    A force jumps there. What a filter in both channels makes of that, or samples taken a little
    late, no effect of body or rig describes, and it may be louder than all that is to be found.
    """
    return replace(problem, settling=max(problem.settling, round(_ABOUT_S / problem.motion.dt)))


def explained_by_timing(whole: Problem, away: Problem, fit: Fit) -> bool:
    """Return whether the residual about the touches can be explained by timing alone.

    `whole` counts the samples there and `away` does not. Whatever averages or delays the channels
    makes no force that the model does not predict somewhere near; adhesion does. Enough samples
    must be left elsewhere.
    """
    counted, kept = whole.whitener.mask > 0.0, away.whitener.mask > 0.0
    if np.count_nonzero(kept) < _FEWEST * np.count_nonzero(counted):
        return False
    hidden = counted & ~kept
    predicted = predict(away, fit)
    width = 2 * away.settling + 1
    least = scipy.ndimage.minimum_filter1d(predicted, width)
    most = scipy.ndimage.maximum_filter1d(predicted, width)
    noise = SIGMAS * float(np.std((away.force - predicted)[kept]))
    beyond = np.maximum(least - noise - away.force, away.force - most - noise).clip(min=0.0)
    left = np.abs(away.force - predicted)
    return float(np.sum(beyond[hidden] ** 2)) <= _BEYOND * float(np.sum(left[hidden] ** 2))
