"""The candidate that comes nearest where no set of effects is an answer."""

from __future__ import annotations

from typing import Any

from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.inference.verdict import explains, family_of
from teleop_rt.diagnosis.recordings.recording import Recording
from teleop_rt.diagnosis.samples.preparation import pose_again
from teleop_rt.metrics import nrmse


def nearest(
    found: Diagnosis, test: Recording | None, surface: float | None = None
) -> dict[str, Any] | None:
    """Return the best candidate, its family, its share of the base's excess, and its errors.

    Errors are NRMSE on `test`, or on held-out blocks without one, over the samples that count for
    the base. None where there is no candidate.
    """
    if not found.candidates:
        return None
    best = found.candidates[0]
    problem = found.problem
    if test is None:
        predicted = [held_out.cross_predict(problem, fit) for fit in (found.base, best.fit)]
    else:
        problem = pose_again(test, best.fit.model.base, surface, problem)
        predicted = [held_out.predict(problem, f.elsewhere) for f in (found.base, best.fit)]
    where = held_out.counted(problem, found.base) > 0.0
    before, after = (nrmse(problem.force[where], row[where]) for row in predicted)
    return {
        "effects": list(best.fit.names),
        "family": family_of(best),
        "share": round(explains(best, found.judgement.excess), 4),
        "before": before,
        "after": after,
    }
