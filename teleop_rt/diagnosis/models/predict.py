"""The force that a model predicts in free run: as it is, or as columns of its linear parameters."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Acts, Effect, Vector
from teleop_rt.diagnosis.models.behind_joint import force_behind, joint_of, linear_behind
from teleop_rt.diagnosis.models.course import Course
from teleop_rt.diagnosis.models.model import CandidateModel
from teleop_rt.diagnosis.models.simulate import run_step
from teleop_rt.diagnosis.samples.motion import RecordedMotion

_SETTLED = 1e-4  # of a parameter; passes end when they change it by less


class Columns(NamedTuple):
    """Prediction = offset + sum of theta_i columns_i."""

    offset: Vector
    columns: list[Vector]

    def sum(self, theta: Vector) -> Vector:
        """Return the prediction at these linear parameters."""
        total = self.offset.copy()
        for value, column in zip(theta, self.columns, strict=True):
            total += value * column
        return total


def force_of(model: CandidateModel, motion: RecordedMotion, zeta: Vector, theta: Vector) -> Vector:
    """Return the prediction at the nonlinear and the linear parameters."""
    course = Course.of(model, motion, zeta)
    moved, nothing = course.moved, np.zeros_like(course.moved.x)
    total, sensed = _tip_and_sensor(course, theta)
    for effect, eta in _acting(course, "slackens"):
        total = run_step(effect, total, nothing, nothing, nothing, 1.0, eta)
    for effect, eta in _acting(course, "filters_force"):
        total = run_step(effect, total, total, total, moved.t, moved.dt, eta)
    total += sensed
    for effect, eta in _acting(course, "limits_force"):
        total = run_step(effect, total, nothing, nothing, nothing, 1.0, eta)
    return total


def slip_of(model: CandidateModel, motion: RecordedMotion, zeta: Vector, theta: Vector) -> Vector:
    """Return the speed at which the tip moves relative to the drive [rig unit/s]."""
    course = Course.of(model, motion, zeta)
    slip: Vector = np.abs(course.moved.v - motion.v)
    tip, nothing = _tip_and_sensor(course, theta)[0], np.zeros_like(slip)
    for effect, eta in _acting(course, "slackens"):
        is_open = run_step(effect, tip, nothing, nothing, nothing, 1.0, eta) == 0.0
        slip = np.where(is_open, np.abs(motion.v), slip)
    return slip


def _tip_and_sensor(course: Course, theta: Vector) -> tuple[Vector, Vector]:
    """Return the force at the tip, and the force that acts in the sensor alone."""
    number = len(course.base)
    tip, sensed = _body_force(course, theta), np.zeros_like(course.moved.x)
    inside = course.cut | course.carried
    rest = zip(theta[number:], course.added, course.behind, inside, strict=True)
    for value, row, behind, cut in rest:
        if cut:
            continue
        if behind:
            sensed += value * row
        else:
            tip += value * row
    return tip, sensed


def _body_force(course: Course, theta: Vector) -> Vector:
    """Return the force of the base with the effects that a joint carries, or that a clamp cuts."""
    if (joint := joint_of(course)) is not None:
        rest = _clamped(course, theta)[0]
        return force_behind(course, joint, theta).force + _other_terms(course, rest, theta)
    number = len(course.base)
    if course.model.clamp == "none":
        return np.asarray(theta[:number] @ course.base)
    spared = ~course.model.cut_terms
    total = np.maximum(_cut_force(course, theta), 0.0)
    return total + theta[:number][spared] @ course.base[spared] if np.any(spared) else total


def columns(course: Course, guess: Vector | None) -> Columns:
    """Return offset and columns of the prediction on a course.

    `guess` are linear parameters near the solution: a clamped base, a compliance, a play at no
    force and a saturation are linearised there (without it they are left out).
    """
    moved, number = course.moved, len(course.base)
    found = Columns(np.zeros_like(moved.x), list(course.base))
    added = course.added
    if guess is not None:
        base, added = _clamped(course, guess)
        found = found._replace(columns=base)
        if (joint := joint_of(course)) is not None:
            offset, base, added = linear_behind(course, joint, base, added, guess)
            found = Columns(offset, base)
    behind = [False] * number + course.behind
    found = Columns(found.offset, [*found.columns, *added])
    if guess is not None:
        for effect, eta in _acting(course, "slackens"):
            found = _linear_in_slack(found, behind, effect, eta, guess)
    offset, rows = found
    for effect, eta in _acting(course, "filters_force"):
        offset, *rows = [
            row if late else run_step(effect, row, row, row, moved.t, moved.dt, eta)
            for row, late in zip((offset, *rows), (not np.any(offset), *behind), strict=True)
        ]
    found = Columns(offset, rows)
    if guess is not None:
        for effect, eta in _acting(course, "limits_force"):
            found = _linear_in_limit(found, effect, eta, guess)
    return found


def settled(course: Course, guess: Vector, theta: Vector) -> bool:
    """Return whether the columns at `theta` are those at the guess, up to rounding.

    With a clamp alone they stay equal while the same samples pull.
    """
    if np.all(np.abs(theta - guess) <= _SETTLED * np.abs(guess)):
        return True
    if any(e.acts in {"deflects", "slackens", "limits_force"} for e in course.model.effects):
        return False
    return bool(np.array_equal(_pulls(course, guess), _pulls(course, theta)))


def _cut_force(course: Course, theta: Vector) -> Vector:
    """Return the force of the base and of the effects that the clamp cuts, before it does."""
    number, cut_terms = len(course.base), course.model.cut_terms
    total: Vector = (theta[:number] * cut_terms) @ course.base
    if not np.any(course.cut):
        return total
    for value, row, cut in zip(theta[number:], course.added, course.cut, strict=True):
        if cut:
            total += value * row
    return total


def _pulls(course: Course, theta: Vector) -> NDArray[np.bool_]:
    """Return where the body would pull, or is not in contact."""
    return np.asarray(_cut_force(course, theta) <= 0.0)


def _clamped(course: Course, theta: Vector) -> tuple[list[Vector], list[Vector]]:
    """Return the columns of base and effects, 0 where a clamped body would pull."""
    if course.model.clamp == "none":
        return list(course.base), course.added
    pulls = _pulls(course, theta)
    terms = zip(course.base, course.model.cut_terms, strict=True)
    base = [np.where(pulls, 0.0, column) if cut else column for column, cut in terms]
    rows = zip(course.added, course.cut, strict=True)
    return base, [np.where(pulls, 0.0, row) if cut else row for row, cut in rows]


def _acting(course: Course, acts: Acts) -> Iterator[tuple[Effect, Vector]]:
    """Yield effects with this action and no free amplitude, with their shape parameters."""
    for effect, (_, eta) in zip(course.model.effects, course.parameters, strict=True):
        if effect.acts == acts and effect.amplitude.unity:
            yield effect, eta


def _other_terms(course: Course, rows: list[Vector], theta: Vector) -> Vector:
    """Return the force of the base's terms beside its spring and damper."""
    total = np.zeros_like(course.moved.x)
    for term, row, value in zip(course.model.base.terms, rows, theta.tolist(), strict=False):
        if term.name not in {"k", "b"}:
            total += value * row
    return total


def _linear_in_slack(
    found: Columns, behind: Sequence[bool], effect: Effect, eta: Vector, guess: Vector
) -> Columns:
    """Pass the force at the tip, before the sensor, through a play; linearised at the guess."""
    tip = [np.zeros_like(r) if late else r for r, late in zip(found.columns, behind, strict=True)]
    bent = _linear_in_limit(found._replace(columns=tip), effect, eta, guess)
    rows = zip(found.columns, bent.columns, behind, strict=True)
    return bent._replace(columns=[row if late else taut for row, taut, late in rows])


def _linear_in_limit(found: Columns, effect: Effect, eta: Vector, guess: Vector) -> Columns:
    """Pass the prediction through a saturation, linearised at the guess."""
    force = found.sum(guess)
    zero = np.zeros_like(force)
    step = 1e-4 * max(float(np.max(np.abs(force))), 1e-12)
    limited, further = (
        run_step(effect, row, zero, zero, zero, 1.0, eta) for row in (force, force + step)
    )
    slope = (further - limited) / step
    return Columns(
        limited + slope * (found.offset - force), [slope * column for column in found.columns]
    )
