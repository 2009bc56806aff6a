"""The error of a fitted set on blocks of the recording that its linear parameters have not seen.

Sets are chosen by it. Its blocks are not those by which the answer's error is judged.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.least_squares import signed_least_squares
from teleop_rt.diagnosis.models.predict import columns

BLOCKS, FOLDS = 10, 5  # apart from the outer ones, 8 in 4 folds


def blind_energy(problem: Problem, fit: Fit) -> float:
    """Return the mean square [force^2] of what the fit leaves of blocks hidden from it.

    Free air counts: a neck pulls there alone. The shapes stay as fitted: few parameters, which a
    block tells little of.
    """
    parts = columns(Course.of(fit.model, problem.motion, fit.zeta), fit.theta)
    where = problem.whitener.mask > 0.0
    target = (problem.force - parts.offset)[where]
    if not parts.columns:
        return float(np.mean(target**2))
    rows = np.array(parts.columns)[:, where]
    nonnegative = np.array([linear.nonnegative for linear in fit.model.linear], dtype=bool)
    fold = ((np.arange(where.size) * BLOCKS // where.size) % FOLDS)[where]
    deviation = float(np.sqrt(np.mean((target - fit.theta @ rows) ** 2)))
    weak = held_out.prior(rows, problem.force[where]) * deviation
    left = np.empty(target.size)
    for number in range(FOLDS):
        hidden = fold == number
        theta = _with_prior(rows[:, ~hidden], target[~hidden], weak, nonnegative)
        left[hidden] = target[hidden] - theta @ rows[:, hidden]
    return float(np.mean(left**2))


def _with_prior(
    rows: Vector, target: Vector, weak: Vector, nonnegative: NDArray[np.bool_]
) -> Vector:
    """Return linear parameters from samples and the weak knowledge that none is enormous."""
    longer = np.concatenate([rows, np.diag(weak)], axis=1)
    return signed_least_squares(longer, np.append(target, np.zeros(weak.size)), nonnegative)
