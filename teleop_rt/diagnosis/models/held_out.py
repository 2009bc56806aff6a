"""The error of a model in free run, on data that were not used to fit its parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.least_squares import centred, signed_least_squares, uncentred
from teleop_rt.diagnosis.models.predict import columns
from teleop_rt.metrics import nrmse
from teleop_rt.recordings.filters import butterworth

BLOCKS = 8  # of a record that are hidden in turn
FOLDS = 4  # in which they are, so that a fold lies at several places
_EVALUATIONS = 4  # of the descent of a refit, which begins at the fit to all blocks
LOW_PASS_HZ = 20.0  # Hz, the bandwidth of published errors of drives
MOST_FORCE = 10.0
"""Prior deviation of one linear parameter's force, over the force's root mean square [1]."""


@dataclass(frozen=True)
class Error:
    """Root-mean-square error over the force's range (4.1 of the report), and over its deviation."""

    nrmse: float | None
    std_normalised: float | None


def counted(problem: Problem, fit: Fit) -> Vector:
    """Return the samples that count: contact, or all of them for a drive in free motion."""
    inside = touches(problem.motion.x) if fit.model.base.touches else np.ones(problem.force.size)
    return problem.whitener.mask * inside


def deviation(problem: Problem, fit: Fit) -> float:
    """Return the standard deviation [rig's force] of the residual, whatever its mean."""
    where = counted(problem, fit) > 0.0
    return float(np.std(problem.residual(fit)[where]))


def smoothable(dt: float) -> bool:
    """Return whether the recording is fast enough for a low-pass of 20 Hz."""
    return 1.0 / dt >= 2.5 * LOW_PASS_HZ


def low_passed(row: Vector, dt: float) -> Vector:
    """Return the row low-passed at 20 Hz: zero-phase Butterworth filter of 4th order."""
    return butterworth(row, LOW_PASS_HZ, dt)


def error(force: Vector, predicted: Vector, where: Vector) -> Error:
    """Return the error over the given samples."""
    chosen = where > 0.0
    measured, rest = force[chosen], force[chosen] - predicted[chosen]
    deviation = float(np.std(measured)) if measured.size > 1 else 0.0
    return Error(
        nrmse(measured, predicted[chosen]),
        float(np.sqrt(np.mean(rest**2))) / deviation if deviation > 0.0 else None,
    )


def prior(rows: Vector, force: Vector) -> Vector:
    """Return 1 over the prior standard deviation of each linear parameter.

    `rows` are its columns (parameters, samples), of all samples that count. A term's force
    cannot far exceed the measured force: the prior bounds a parameter that the samples of a fit do
    not determine, such as a damping while the tool rests.
    """
    size = MOST_FORCE * float(np.sqrt(np.mean(force**2)))
    return np.asarray(np.sqrt(np.mean(rows**2, axis=1)) / size, dtype=np.float64)


def _with_prior(problem: Problem, whole: Problem, fit: Fit) -> Fit:
    """Return the fit with linear parameters by the samples and the `prior`."""
    if not fit.theta.size:
        return fit
    where = counted(whole, fit) > 0.0
    parts = columns(Course.of(fit.model, problem.motion, fit.zeta), fit.theta)
    constant = fit.model.base.bias_place
    rows, shares = centred(np.array(parts.columns)[:, where], constant)
    weak = prior(rows, problem.force[where])
    seen = (
        fit.columns if constant is None else fit.columns - np.outer(shares, fit.columns[constant])
    )
    target = fit.residual + fit.theta @ fit.columns
    theta = signed_least_squares(
        np.concatenate([seen, np.diag(weak)], axis=1),
        np.append(target, np.zeros(weak.size)),
        fit.model.nonnegative,
    )
    return replace(fit, theta=uncentred(theta, shares, constant))


def folds(size: int) -> NDArray[np.intp]:
    """Return the fold in which each sample of a record is hidden."""
    return np.asarray(np.arange(size) * BLOCKS // size % FOLDS, dtype=np.intp)


def cross_predict(problem: Problem, fit: Fit) -> Vector:
    """Return the force predicted for each block by parameters fitted without it.

    Blocks are interleaved, so each fold sees the beginning as well as the end. The model runs
    through the whole motion; only the force of the block is hidden from the fit. The motion before
    the recording is part of its data, and is estimated from the whole of it.
    """
    motion = problem.motion
    before = fit.force_on(motion) - fit.elsewhere.force_on(motion)
    problem, fit = replace(problem, force=problem.force - before), fit.elsewhere
    size = problem.force.size
    fold = folds(size)
    predicted = np.zeros(size)
    for number in range(FOLDS):
        blind = problem.keeping(problem.whitener.mask * (fold != number))
        refit = _with_prior(blind, problem, blind.refine(fit.model, fit.zeta, _EVALUATIONS))
        hidden = fold == number
        predicted[hidden] = refit.force_on(motion)[hidden]
    return predicted + before
