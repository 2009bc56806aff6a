"""Detection of a force with the wrong sign, for a base without contact."""

from __future__ import annotations

import numpy as np

from teleop_rt.diagnosis.models.fit import Problem
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.recordings.column_names import turned

EXPLAINED = 0.5  # share of the force's variance; below it a sign is not significant
PASSIVE = {"k": "spring", "b": "damper", "c": "damper", "m": "mass"}


def turned_sign(
    problem: Problem, model: CandidateModel, columns: tuple[str, str] = ("NAME", "NAME")
) -> str | None:
    """Return a note if the passive term with the largest force has a negative parameter.

    The base is fitted with free signs. None where it touches (the surface shows the sign there),
    explains less than half of the variance, or its largest term is positive.
    """
    base, motion = model.base, problem.motion
    if base.touches or not base.terms:
        return None
    used = problem.whitener.mask > 0.0
    rows = np.array(base.columns(motion.x, motion.v, motion.a, 1.0))[:, used]
    rows -= rows.mean(axis=1, keepdims=True)
    force = problem.force[used] - problem.force[used].mean()
    theta, *_ = np.linalg.lstsq(rows.T, force, rcond=None)
    energy = float(force @ force)
    if energy <= 0.0 or 1.0 - float(np.sum((force - theta @ rows) ** 2)) / energy < EXPLAINED:
        return None
    sizes = np.abs(theta) * rows.std(axis=1)
    largest = int(np.argmax(sizes))
    name = base.terms[largest].name
    if name not in PASSIVE or theta[largest] >= 0.0:
        return None
    return (
        f"wrong sign? most of the force is that of a {PASSIVE[name]} of {name} ="
        f" {theta[largest]:.3g}, which no passive body has: if the force counts positive when the"
        f" tool is pulled, turn it with {turned(columns, 'force')}"
    )
