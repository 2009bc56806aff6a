"""Prediction of a recording that no fit used: its errors and its residuals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from teleop_rt.diagnosis.answers import held_out
from teleop_rt.diagnosis.answers.errors import HeldOut, errors_of, on_record
from teleop_rt.diagnosis.answers.residuals import Residuals
from teleop_rt.diagnosis.models.fit import Fit, Problem
from teleop_rt.diagnosis.noise.noise_floor import noise_floor, with_own_noise
from teleop_rt.diagnosis.recordings.recording import Recording
from teleop_rt.diagnosis.samples.preparation import pose_again


@dataclass(frozen=True)
class Unseen:
    """Another recording as a problem, and its force as two fits predict it, with its `units`."""

    problem: Problem
    predicted: HeldOut
    units: tuple[str, str]

    @property
    def errors(self) -> dict[str, Any]:
        """The answer's `error`, before and after."""
        return errors_of(self.predicted, self.problem.motion.dt)

    @property
    def residuals(self) -> Residuals:
        """The residuals before and after, of the samples that count."""
        motion, predicted = self.problem.motion, self.predicted
        where = np.flatnonzero(predicted.where > 0.0)
        return Residuals(
            t=motion.t[where],
            x=motion.x[where],
            v=motion.v[where],
            before=(predicted.force - predicted.before)[where],
            after=(predicted.force - predicted.after)[where],
            dt=motion.dt,
            units=self.units,
        )


def predict_recording(
    test: Recording,
    base: Fit,
    best: Fit,
    like: Problem,
    surface: float | None,
    in_air: tuple[Fit, ...] = (),
) -> Unseen:
    """Return the prediction of a recording by a base alone and by the best model.

    It is prepared as the problem `like` was; `surface` overrides its own [rig unit]. For fits
    `in_air` see `noise_floor`.
    """
    fresh, rows = with_own_noise(pose_again(test, best.model.base, surface, like), best, test)
    noise = noise_floor(fresh, best, rows, held_out.counted(fresh, best), in_air)
    return Unseen(fresh, on_record(fresh, base, best, noise), test.units)
