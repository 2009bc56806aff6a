"""Detection of stretches in which the force sensor dropped out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.recordings.filters import running_rank
from teleop_rt.recordings.rows import Stretch, robust_deviation, stretches

_FEWEST_SAMPLES, _LEAST_S = 5, 0.01  # samples, and s: a shorter stretch is an outlier
_DROPOUT_RATIO = 10.0  # of the residual to its usual deviation in a dropout
_REPEATED_RATIO = 5.0  # of the same, at which further stretches show that the model is wrong
_HELD_SHARE = 0.5  # of the error; a dead channel's reading varies by less, and jumps by more
_MOST_DROPOUTS = 3  # stretches; more of them are an error of the model
_TOUCH_MARGIN_S = 0.03  # s beside a touch, where forces jump


def dropouts(problem: Problem, fit: Fit) -> list[Stretch]:
    """Return first sample and first past of each stretch of 10 ms or more far off a fit.

    The residual must be ten times its usual deviation, which excludes noise and the form of a law.
    The force must hold one value and jump to it or from it: the force of a body that no law
    describes, such as a layer that a single press reaches, follows the motion. Stretches at
    touches, where forces jump, do not count. If more than `_MOST_DROPOUTS` stretches reach half of
    that, the model is wrong and the result is empty.
    """
    dt = problem.motion.dt
    width = max(_FEWEST_SAMPLES, round(_LEAST_S / dt)) | 1
    counted = problem.whitener.mask > 0.0
    depth = problem.motion.x + fit.model.shift(fit.zeta)
    inside = touches(depth)
    left = problem.residual(fit)
    off = np.where(counted, np.abs(left), 0.0)
    sides = (off[counted & side] for side in (inside, ~inside))
    usual = max((robust_deviation(row) for row in sides if row.size > _FEWEST_SAMPLES), default=0.0)
    held = running_rank(off, width, 0.5)
    crossings = np.flatnonzero(np.diff(inside))
    about, wider = round(_TOUCH_MARGIN_S / dt), width // 2 + 1

    def beyond(least: float) -> list[Stretch]:
        return [
            (max(first - wider, 0), min(past + wider, off.size))
            for first, past in stretches(held > least)
            if not np.any((crossings > first - about) & (crossings < past + about))
        ]

    def dead(stretch: Stretch) -> bool:
        first, past = stretch
        if past - first - 2 * wider < _FEWEST_SAMPLES:  # a clump of outliers
            return False
        held_force = problem.force[first + wider + 1 : past - wider - 1]
        least = _HELD_SHARE * float(np.median(off[first + wider : past - wider]))
        ends = (left[max(at - width, 0) : at + width] for at in (first + wider, past - wider))
        return float(np.ptp(held_force)) < least < max(map(_largest_jump, ends))

    if len(beyond(_REPEATED_RATIO * usual)) > _MOST_DROPOUTS:
        return []
    return [stretch for stretch in beyond(_DROPOUT_RATIO * usual) if dead(stretch)]


def _largest_jump(row: Vector) -> float:
    """Return the largest difference of two values with one between them."""
    return float(np.max(np.abs(row[2:] - row[:-2]), initial=0.0))


def without(problem: Problem, lost: Sequence[Stretch]) -> Problem:
    """Return the problem without the samples of the stretches."""
    mask = problem.whitener.mask.copy()
    for first, past in lost:
        mask[first:past] = 0.0
    return problem.keeping(mask)
