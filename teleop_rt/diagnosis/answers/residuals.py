"""The residuals of a diagnosis along its motion, as its figures show them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.answers.held_out import counted, predict
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.models.fit import Fit


@dataclass(frozen=True)
class Residuals:
    """Measured force minus that of the model in free run, of the n samples that count.

    Rows have shape (n,): `t` [s], penetration `x` and velocity `v` in the rig's unit, `before` with
    the base alone and `after` with the effects [rig's force]; `after` is None where none was added.
    `dt` is the sampling period [s], `units` those of position and force.
    """

    t: Vector
    x: Vector
    v: Vector
    before: Vector
    after: Vector | None
    dt: float
    units: tuple[str, str]

    def by_name(self) -> dict[str, Vector]:
        """Return the residuals as `before` and, if there is one, `after`."""
        return {"before": self.before} | ({} if self.after is None else {"after": self.after})


def residuals_of(found: Diagnosis, units: tuple[str, str], drafted: Fit | None = None) -> Residuals:
    """Return the residuals of a diagnosis; `drafted` takes the place of its best fit."""
    problem, motion = found.problem, found.problem.motion
    where = np.flatnonzero(counted(problem, found.base) > 0.0)
    later = drafted or (found.best if found.judgement.sets else None)

    def left(fit: Fit) -> Vector:
        return np.asarray((problem.force - predict(problem, fit))[where], dtype=np.float64)

    return Residuals(
        t=motion.t[where],
        x=motion.x[where],
        v=motion.v[where],
        before=left(found.base),
        after=None if later is None else left(later),
        dt=motion.dt,
        units=units,
    )
