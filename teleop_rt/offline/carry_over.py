"""Of models that explain each of two recordings, those whose parameters hold from one to the other.

A law with a free shape can bend after any one motion; after two of them with one shape it cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from teleop_rt.diagnosis.diagnose import predicted_on
from teleop_rt.diagnosis.inference.ranked import Ranked
from teleop_rt.diagnosis.inference.rounds import Diagnosis
from teleop_rt.diagnosis.models.fit import Fit
from teleop_rt.diagnosis.samples.motion import RecordedMotion
from teleop_rt.recordings.recording import Recording

_DROP_RATIO = 2.0
"""Ratio of a set's error on the other recording to the best one's, from which it is dropped."""
_LATER_S = 1.0
"""By how much a motion is moved in time to find effects that depend on the time itself."""


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """A recording and its diagnosis."""

    recording: Recording
    diagnosis: Diagnosis

    @property
    def sets(self) -> list[list[str]]:
        """The sets of effects that the data do not exclude, best first; outliers are in none."""
        judgement = self.diagnosis.judgement
        decided = judgement.verdict in {"named", "class"}
        return [list(r.fit.names) for r in judgement.sets] if decided else []

    def fitted(self, names: Sequence[str]) -> Ranked:
        """Return the set of these effects as fitted to this recording."""
        return next(r for r in self.diagnosis.judgement.sets if list(r.fit.names) == list(names))


def carried_over(one: Diagnosed, other: Diagnosed, sets: list[list[str]]) -> list[list[str]]:
    """Return those of the sets, which both diagnoses hold, that carry over between the recordings.

    Each predicts either recording in free run by all its parameters from the other one. A set
    that predicts one of them more than twice as badly as another is left out. A law of time itself
    stays: the clocks of two recordings have nothing in common.
    """
    timeless = [n for n in sets if not _follows_clock(one.fitted(n).fit, _motion(one))]
    if len(timeless) < 2:
        return sets
    worst = np.zeros(len(timeless))
    for here, there in ((one, other), (other, one)):
        errors = np.array([_error(here, there.recording, names) for names in timeless])
        worst = np.maximum(worst, errors / np.min(errors))
    gone = [names for names, ratio in zip(timeless, worst, strict=True) if ratio > _DROP_RATIO]
    return [names for names in sets if names not in gone]


def holds_farther(one: Diagnosed, other: Diagnosed, names: Sequence[str]) -> bool:
    """Return whether the set fitted to `one` predicts `other` better than vice versa.

    Over a shallow motion laws of several shapes fit equally well, and differ beyond its depth.
    Terms that depend on time itself are those of the later motion, and so of `other`.
    """
    if _follows_clock(one.fitted(names).fit, _motion(one)):
        return False
    there, back = (
        _over_floor(here, to.recording, names) for here, to in ((one, other), (other, one))
    )
    return there < back


def _motion(of: Diagnosed) -> RecordedMotion:
    return of.diagnosis.problem.motion


def _error(here: Diagnosed, there: Recording, names: Sequence[str]) -> float:
    """Return the error on another recording, but no less than the noise there."""
    found = _errors(here, there, names)
    return float(max(found["after"], found["noise_floor"]))


def _over_floor(here: Diagnosed, there: Recording, names: Sequence[str]) -> float:
    return float(_errors(here, there, names)["after_over_floor"])


def _errors(here: Diagnosed, there: Recording, names: Sequence[str]) -> dict[str, Any]:
    judgement = replace(here.diagnosis.judgement, sets=(here.fitted(names),))
    return predicted_on(replace(here.diagnosis, judgement=judgement), there, named=True).errors


def _follows_clock(fit: Fit, motion: RecordedMotion) -> bool:
    """Return whether the model predicts another force for the same motion at another time."""
    later = replace(motion, t=motion.t + _LATER_S)
    now, then = (fit.force_on(m) for m in (motion, later))
    return not np.allclose(now, then, rtol=0.0, atol=1e-9 * float(np.max(np.abs(now))))
