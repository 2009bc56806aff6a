"""Instrumental variables: parameters that a closed loop does not bias.

In closed loop the measured motion contains the force noise, which biases least squares
(Janot, Vandanjon and Gautier 2014). The commanded motion does not.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.answers.answer import fill, finite
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.models.predict import columns, force_of
from teleop_rt.diagnosis.samples.motion import motion_of
from teleop_rt.recordings.recording import Recording


def by_reference(
    problem: Problem, fit: Fit, recording: Recording, unseen: Problem | None
) -> dict[str, Any] | None:
    """Return the linear parameters by instruments from the commanded motion, for JSON.

    The result also contains the least-squares estimates and the errors of both, on `unseen` or on
    the recording itself. None without a reference, or if it does not determine the parameters.
    """
    if recording.reference is None or not fit.model.linear:
        return None
    surface = float(np.median(recording.position - problem.motion.x))
    half = problem.motion.half
    wanted = motion_of(recording.reference, recording.force, recording.dt, surface, half)
    instruments = problem.whitener(
        np.array(columns(Course.of(fit.model, wanted, fit.zeta), fit.theta).columns)
    )
    target = fit.residual + fit.theta @ fit.columns
    crossed = instruments @ fit.columns.T
    if np.linalg.cond(crossed) > 1e14:
        return None
    theta = np.asarray(np.linalg.solve(crossed, instruments @ target), dtype=np.float64)
    left = target - theta @ fit.columns
    inverse = np.linalg.inv(crossed)
    spread = inverse @ (instruments @ instruments.T) @ inverse.T * float(left @ left) / left.size
    where = unseen or problem
    return {
        "from": "reference",
        "parameters": {
            linear.name: {
                "value": finite(theta[i]),
                "std": finite(np.sqrt(max(spread[i, i], 0.0))),
                "least_squares": finite(fit.theta[i]),
                "unit": fill(linear.unit, recording.units),
            }
            for i, linear in enumerate(fit.model.linear)
        },
        "error": {
            "on": "recording itself" if unseen is None else "held-out record",
            "instruments": _error(where, fit, theta),
            "least_squares": _error(where, fit, fit.theta),
        },
    }


def _error(problem: Problem, fit: Fit, theta: Vector) -> dict[str, float | None]:
    """Return the free-run error over the force's deviation, raw and low-passed (20 Hz)."""
    predicted = force_of(fit.model, problem.motion, fit.zeta, theta)
    where = held_out.counted(problem, fit)
    dt = problem.motion.dt
    found = {"std_normalised": held_out.error(problem.force, predicted, where).std_normalised}
    if held_out.smoothable(dt):
        force, smooth = (held_out.low_passed(row, dt) for row in (problem.force, predicted))
        found["std_normalised_low_passed"] = held_out.error(force, smooth, where).std_normalised
    return found
