"""Error before and after on data that no fit used, for JSON."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.models import held_out
from teleop_rt.diagnosis.models.fit import Fit, Problem

UNPREDICTABLE = 10.0
"""Error over the force's deviation [1]; the mean alone errs by 1, so ten times is no prediction."""


@dataclass(frozen=True)
class HeldOut:
    """Force that no fit used, its predictions before and after, and its noise."""

    on: str
    problem: Problem
    before: Vector
    after: Vector
    where: Vector
    noise: float

    @property
    def errors(self) -> dict[str, Any]:
        """The errors before and after, and the noise floor as it was estimated."""
        force, where = self.problem.force, self.where
        before, after = (
            defined(held_out.error(force, p, where)) for p in (self.before, self.after)
        )
        span = float(np.ptp(force[where > 0.0])) if np.any(where) else 0.0
        least = self.noise / span if span > 0.0 else None
        return {
            "metric": "nrmse",
            "on": self.on,
            "before": before.nrmse,
            "after": after.nrmse,
            "noise_floor": least,
            "after_over_floor": after.nrmse / least if after.nrmse is not None and least else None,
            "std_normalised": {"before": before.std_normalised, "after": after.std_normalised},
            "std_normalised_low_passed": self._low_passed_errors(),
        }

    @property
    def shown_errors(self) -> dict[str, Any]:
        """The same with a noise floor that neither error contradicts."""
        return bounded_floor(self.errors)

    def _low_passed_errors(self) -> dict[str, Any] | None:
        """Return the errors with force and prediction low-passed alike; null for slow recordings.

        Samples that do not count are replaced by their measured force: the filter would otherwise
        spread a dropout or a touch over their neighbours.
        """
        force, dt, counts = self.problem.force, self.problem.motion.dt, self.where > 0.0
        if not held_out.smoothable(dt):
            return None
        smooth = held_out.low_passed(force, dt)
        predicted = (np.where(counts, p, force) for p in (self.before, self.after))
        found = [held_out.error(smooth, held_out.low_passed(p, dt), self.where) for p in predicted]
        found = [defined(one) for one in found]
        return {
            "filter": "zero-phase Butterworth, 4th order, 20 Hz, on force and prediction",
            "before": found[0].std_normalised,
            "after": found[1].std_normalised,
        }


@dataclass(frozen=True)
class Blocks:
    """Held-out blocks of the recording itself: each is predicted by a fit without it.

    `plain` has the weights for the `base` alone, `problem` those for the best model.
    """

    plain: Problem
    problem: Problem
    base: Fit

    @cached_property
    def _known(self) -> list[tuple[Problem, Fit, Vector]]:
        return []

    def force(self, problem: Problem, fit: Fit) -> Vector:
        """Return the force that refits by a problem's weights predict."""
        for weights, known, force in self._known:
            if weights is problem and known is fit:
                return force
        force = held_out.cross_predict(problem, fit)
        self._known.append((problem, fit, force))
        return force

    def predicted(self, best: Fit, noise: float) -> HeldOut:
        """Return the prediction; `noise` is the deviation that a perfect model would leave."""
        before = self.force(self.plain, self.base)
        after = before if best is self.base else self.force(self.problem, best)
        where = scored(self.problem, self.base, best, after)
        return HeldOut("held-out blocks", self.problem, before, after, where, noise)


def scored(problem: Problem, base: Fit, best: Fit, after: Vector) -> Vector:
    """Return the samples at which errors count: those of the base, and where the body acts in air.

    An adhesion may pull in free air alone. `after` is the force that the `best` fit predicts.
    """
    where = held_out.counted(problem, base)
    pulls = any(
        effect.belongs_to == "environment"
        and effect.acts == "adds_force"
        and not effect.only_in_contact
        for effect in best.model.effects
    )
    return np.where(after != 0.0, problem.whitener.mask, where) if pulls else where


def on_record(fresh: Problem, base: Fit, best: Fit, noise: float) -> HeldOut:
    """Return the prediction of another recording."""
    before, after = (fit.elsewhere.force_on(fresh.motion) for fit in (base, best))
    where = scored(fresh, base, best, after)
    return HeldOut("held-out record", fresh, before, after, where, noise)


def explained(unseen: HeldOut) -> float:
    """Return the share [at most 1] of the base's energy above the noise that is explained there."""
    where = unseen.where > 0.0
    if not np.any(where):
        return 1.0
    before, after = (
        float(np.mean((unseen.problem.force - predicted)[where] ** 2)) - unseen.noise**2
        for predicted in (unseen.before, unseen.after)
    )
    return 1.0 - max(after, 0.0) / before if before > 0.0 else 1.0


def bounded_floor(errors: Mapping[str, Any], *others: Mapping[str, Any]) -> dict[str, Any]:
    """Return an answer's `error` with a noise floor that none of its errors contradicts.

    The noise is in each of them, so none is smaller: `others` are those of the nearest candidate
    and of a draft on the same data.
    """
    floor, after = errors["noise_floor"], errors["after"]
    if floor is None:
        return dict(errors)
    every = [one.get(key) for one in (errors, *others) for key in ("before", "after")]
    floor = min([floor, *(error for error in every if error is not None)])
    ratio = after / floor if after is not None and floor > 0.0 else None
    return {**errors, "noise_floor": floor, "after_over_floor": ratio}


def predicts_worse(answer: Mapping[str, Any]) -> bool:
    """Return whether the draft of an answer predicts worse than a set of effects in it."""
    sets = [answer[key] for key in ("error", "nearest") if answer.get(key)]
    known = [one["after"] for one in sets if one["after"] is not None]
    after = answer["draft"]["error"]["after"]
    return bool(known) and (after is None or after > min(known))


def is_beaten(answer: Mapping[str, Any]) -> bool:
    """Return whether the nearest candidate errs less than the set whose errors are given."""
    nearest, after = answer["nearest"], answer["error"]["after"]
    if nearest is None or nearest["after"] is None or after is None:
        return False
    return bool(nearest["after"] < after)


def defined(error: held_out.Error) -> held_out.Error:
    """Return the error, without figures if it is so large that the model predicts nothing."""
    size = error.std_normalised
    return held_out.Error(None, None) if size is None or size > UNPREDICTABLE else error
