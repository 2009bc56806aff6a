"""Residuals along the motion, as figures show them, and the prediction of another recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.answers.errors import Blocks, HeldOut, is_beaten, on_record, scored
from teleop_rt.diagnosis.inference.ranked import explains, family_of
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.inference.sets import OF_TIME
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.noise_floor import NoiseLevels, with_own_noise
from teleop_rt.diagnosis.samples.preparation import pose_again
from teleop_rt.metrics import nrmse
from teleop_rt.recordings.recording import Recording


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


def _residuals(
    problem: Problem, where: Vector, before: Vector, after: Vector | None, units: tuple[str, str]
) -> Residuals:
    """Return the residuals of predictions (samples,) where they count."""
    motion, some = problem.motion, np.flatnonzero(where > 0.0)
    later = None if after is None else (problem.force - after)[some]
    rows = (motion.t[some], motion.x[some], motion.v[some], (problem.force - before)[some])
    return Residuals(*rows, later, motion.dt, units)


def residuals_of(found: Diagnosis, units: tuple[str, str], drafted: Fit | None = None) -> Residuals:
    """Return the residuals of a diagnosis; `drafted` takes the place of its best fit."""
    problem = found.problem
    later = drafted or (found.best if found.judgement.sets else None)
    before = found.base.force_on(problem.motion)
    after = None if later is None else later.force_on(problem.motion)
    where = scored(problem, found.base, later or found.base, before if after is None else after)
    return _residuals(problem, where, before, after, units)


def residuals_on(unseen: HeldOut, units: tuple[str, str]) -> Residuals:
    """Return the residuals of another recording, of the samples that count."""
    return _residuals(unseen.problem, unseen.where, unseen.before, unseen.after, units)


def predict_recording(
    test: Recording,
    base: Fit,
    best: Fit,
    like: Problem,
    surface: float | None,
    in_air: tuple[Fit, ...] = (),
) -> HeldOut:
    """Return the prediction of a recording by a base alone and by the best model.

    It is prepared as the problem `like` was; `surface` overrides its own [rig unit]. For fits
    `in_air` see `NoiseLevels.perfect`.
    """
    fresh, rows = with_own_noise(pose_again(test, best.model.base, surface, like), best, test)
    levels = NoiseLevels(fresh, best, rows, held_out.counted(fresh, best))
    return on_record(fresh, base, best, levels.perfect(in_air))


def nearest(
    found: Diagnosis, test: Recording | None, surface: float | None = None
) -> dict[str, Any] | None:
    """Return the best candidate where no set is an answer; see `Nearest` for its keys.

    Errors are on `test`, or on held-out blocks without one. None where there is no candidate.
    """
    if not found.candidates:
        return None
    best, problem = found.candidates[0], found.problem
    if test is None:
        unseen = Blocks(problem, problem, found.base).predicted(best.fit, 0.0)
    else:
        problem = pose_again(test, best.fit.model.base, surface, problem)
        unseen = on_record(problem, found.base, best.fit, 0.0)
    force, where = unseen.problem.force, unseen.where > 0.0
    before, after = (nrmse(force[where], p[where]) for p in (unseen.before, unseen.after))
    return {
        "effects": list(best.fit.names),
        "family": family_of(best),
        "share": round(explains(best, found.judgement.excess), 4),
        "before": before,
        "after": after,
    }


def of_nearest(found: Diagnosis, answer: dict[str, Any]) -> list[str]:
    """Return the note on a nearest candidate that errs less than the set chosen to predict."""
    if not is_beaten(answer):
        return []
    of_time = [e.name for e in found.candidates[0].fit.model.effects if e.family in OF_TIME]
    why = (
        f"it holds a law of time ({', '.join(of_time)}), which carries over to no other recording"
        if of_time
        else "the latter was chosen on other blocks, before these errors were known"
    )
    return [f"the nearest set errs less than the one chosen to predict: {why}"]
