"""The error of a model in free run, on data that its parameters have not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.fit import Fit, Problem
from teleop_rt.diagnosis.predict import force_of
from teleop_rt.metrics import nrmse

BLOCKS = 8
FOLDS = 4
LOW_PASS_HZ = 20.0


@dataclass(frozen=True)
class Error:
    """Root-mean-square error over the force's range (4.1 of the report), and over its deviation."""

    nrmse: float | None
    std_normalised: float | None


def predict(problem: Problem, fit: Fit) -> Vector:
    """Return the force in free run: from the motion alone, memories simulated from the start."""
    return force_of(fit.model, problem.motion, fit.zeta, fit.theta)


def counted(problem: Problem, fit: Fit) -> Vector:
    """Return where the error counts: over contact, or everywhere for a drive in free motion."""
    inside = problem.motion.x > 0.0 if fit.model.base.touches else np.ones(problem.force.size)
    return problem.whitener.mask * inside


def loudness(problem: Problem, fit: Fit) -> float:
    """Return the root mean square of the residual over the standard deviation of the force.

    A bias that the model leaves is an error as any other.
    """
    where = counted(problem, fit) > 0.0
    rest = (problem.force - predict(problem, fit))[where]
    return float(np.sqrt(np.mean(rest**2))) / max(float(np.std(problem.force[where])), 1e-300)


def smoothable(dt: float) -> bool:
    """Tell whether the recording is fast enough for a low-pass of 20 Hz."""
    return 1.0 / dt >= 2.5 * LOW_PASS_HZ


def low_passed(row: Vector, dt: float) -> Vector:
    """Return the row without what lies above 20 Hz: zero-phase, Butterworth of 4th order."""
    return np.asarray(
        scipy.signal.sosfiltfilt(
            scipy.signal.butter(4, LOW_PASS_HZ, fs=1.0 / dt, output="sos"), row
        ),
        dtype=np.float64,
    )


def error(force: Vector, predicted: Vector, where: Vector) -> Error:
    """Return the error over the samples told."""
    chosen = where > 0.0
    measured, rest = force[chosen], force[chosen] - predicted[chosen]
    deviation = float(np.std(measured)) if measured.size > 1 else 0.0
    return Error(
        nrmse(measured, predicted[chosen]),
        float(np.sqrt(np.mean(rest**2))) / deviation if deviation > 0.0 else None,
    )


def cross_predict(problem: Problem, fit: Fit, evaluations: int = 4) -> Vector:
    """Return the force predicted for each block by parameters fitted without it.

    Blocks are interleaved, so each fold sees the beginning as well as the end. The model runs
    through the whole motion; only the force of the block is hidden from the fit. What came before
    the recording is part of its data, and taken as the whole of it tells.
    """
    before = predict(problem, fit) - predict(problem, fit.elsewhere)
    problem, fit = replace(problem, force=problem.force - before), fit.elsewhere
    whole = problem.whitener
    size = problem.force.size
    fold = (np.arange(size) * BLOCKS // size) % FOLDS
    predicted = np.zeros(size)
    for number in range(FOLDS):
        kept = whole.mask * (fold != number)
        blind = replace(problem, whitener=replace(whole, mask=kept))
        refit = blind.refine(fit.model, fit.zeta, evaluations)
        hidden = fold == number
        predicted[hidden] = predict(blind, refit)[hidden]
    return predicted + before
