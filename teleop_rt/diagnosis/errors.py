"""Error before and after on data that the fits have not seen, for JSON."""

from __future__ import annotations

from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis import held_out
from teleop_rt.diagnosis.fit import Fit, Problem
from teleop_rt.diagnosis.surface import force_noise


def errors_of(problem: Problem, base: Fit, best: Fit, fresh: Problem | None) -> dict[str, Any]:
    """Return error before and after, and the noise floor: on `fresh`, or on held-out blocks."""
    if fresh is None:
        where = held_out.counted(problem, base)
        force = problem.force
        predicted = [held_out.cross_predict(problem, fit) for fit in (base, best)]
    else:
        where = held_out.counted(fresh, base)
        force = fresh.force
        predicted = [held_out.predict(fresh, fit) for fit in (base, best)]
    before, after = (held_out.error(force, p, where) for p in predicted)
    floor = _noise_floor(force, where)
    return {
        "metric": "nrmse",
        "on": "held-out blocks" if fresh is None else "held-out record",
        "before": before.nrmse,
        "after": after.nrmse,
        "noise_floor": floor,
        "after_over_floor": after.nrmse / floor if after.nrmse is not None and floor else None,
        "std_normalised": {"before": before.std_normalised, "after": after.std_normalised},
        "std_normalised_low_passed": _low_passed_errors(force, predicted, where, problem.motion.dt),
    }


def _low_passed_errors(
    force: Vector, predicted: list[Vector], where: Vector, dt: float
) -> dict[str, Any] | None:
    """Return the errors with force and prediction low-passed alike; null for slow recordings."""
    if 1.0 / dt < 2.5 * held_out.LOW_PASS_HZ:
        return None
    smooth = held_out.low_passed(force, dt)
    found = [held_out.error(smooth, held_out.low_passed(p, dt), where) for p in predicted]
    return {
        "filter": "zero-phase Butterworth, 4th order, 20 Hz, on force and prediction",
        "before": found[0].std_normalised,
        "after": found[1].std_normalised,
    }


def _noise_floor(force: Vector, where: Vector) -> float | None:
    """Return the noise's deviation over the range of the force."""
    span = float(np.ptp(force[where > 0.0])) if np.any(where) else 0.0
    return force_noise(force) / span if span > 0.0 else None
