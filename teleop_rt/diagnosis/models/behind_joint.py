"""The force of a body behind a joint in series: the base, and the effects that deform with it.

The joint gives way under the whole force, so the tool is less deep in the body than the drive is.
The effects of the body are evaluated at the tool's depth. It depends on their own force: passes
alternate, in each the force of the effects is a load beside the base, whose part that grows with
the depth acts as a spring.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.models.course import Course, Place
from teleop_rt.diagnosis.models.in_series import (
    NO_LOAD,
    BodyLoad,
    Joint,
    SpringDamper,
    press_in_series,
)
from teleop_rt.diagnosis.models.simulate import rate_of

_MOST_PASSES = 6  # of depth and force; each leaves a fifth of the error, or less
_SETTLED = 1e-4  # of the largest force; passes end when they change it by less
_RUNAWAY = 10.0  # times the force; passes that change it by more diverge, and the last one stays
_LEAST_SPRING = -0.8  # of the base's stiffness; a load that falls faster with the depth lets go
_STEP = 1e-3  # of the recording's largest force: step of a load, whose difference is its column


class Behind(NamedTuple):
    """The `force` (samples,) behind a joint, and the columns of the effects there at that depth."""

    force: Vector
    added: list[Vector]
    load: BodyLoad


def joint_of(course: Course) -> Joint | None:
    """Return the joint in series with the base's spring, None without one or without a spring."""
    if "k" not in _names(course):
        return None
    for effect, (amplitude, eta) in zip(course.model.effects, course.parameters, strict=True):
        if effect.acts == "deflects":
            return Joint(amplitude, float(eta[0]) if effect.shapes else inf)
    return None


def force_behind(course: Course, joint: Joint, theta: Vector) -> Behind:
    """Return the force of base and body at linear parameters `theta`, in the model's order."""
    material = _material(course, theta)
    found = Behind(_press(course, joint, material, NO_LOAD)[0], [], NO_LOAD)
    carried = np.append(np.zeros(len(course.base), dtype=bool), course.carried)
    if not np.any(carried):
        return found
    for _ in range(_MOST_PASSES):
        depth = _tool(course, joint, found.force)
        rows = course.carried_rows(depth)
        load = _load(theta[carried], rows, depth, material.k)
        force = _press(course, joint, material, load)[0]
        change = float(np.max(np.abs(force - found.force)))
        # The first pass always counts; a change that is not a number ends them as well.
        if found.added and not change <= _RUNAWAY * float(np.max(np.abs(found.force))):
            break
        found = Behind(force, rows, load)
        if change <= _SETTLED * float(np.max(np.abs(force))):
            break
    return found


def linear_behind(
    course: Course, joint: Joint, base: list[Vector], added: list[Vector], guess: Vector
) -> tuple[Vector, list[Vector], list[Vector]]:
    """Return offset and columns of base and effects, linearised at the guess.

    The columns of k and b are the derivatives of the force behind the joint, and so are those of
    the effects there. The offset makes the linearisation exact at the guess.
    """
    names, rows, further = _names(course), list(base), list(added)
    material, behind = _material(course, guess), force_behind(course, joint, guess)
    force, by_k, by_b = _press(course, joint, material, behind.load, slopes=True)
    rows[names.index("k")] = by_k
    offset: Vector = force - material.k * by_k
    if "b" in names:
        rows[names.index("b")] = by_b
        offset = offset - material.b * by_b
    places = np.flatnonzero(course.carried)
    for place, row in zip(places.tolist(), behind.added, strict=True):
        step = _STEP * course.motion.scales["force"] / max(float(np.max(np.abs(row))), 1e-300)
        load = behind.load._replace(force=behind.load.force + step * row)
        further[place] = (_press(course, joint, material, load)[0] - force) / step
        offset = offset - guess[len(rows) + place] * further[place]
    return offset, rows, further


def _tool(course: Course, joint: Joint, force: Vector) -> Place:
    """Return depth and velocity of the tool, behind the deflection under `force` (samples,) [f]."""
    moved = course.moved
    bent = joint.compliance * force / (1.0 + np.abs(force) / joint.seated)
    return Place(moved.x - bent, moved.v - rate_of(bent, moved.dt), None)


def _load(theta: Vector, rows: list[Vector], depth: Place, stiffness: float) -> BodyLoad:
    """Return the effects' force at a depth, with its least-squares spring through the origin.

    `rows` are the columns (samples,) of the effects, `stiffness` is the base's [f/x].
    """
    force: Vector = theta @ np.array(rows)
    pressed = np.maximum(depth.x, 0.0)
    spring = float(force @ pressed) / max(float(pressed @ pressed), 1e-300)
    spring = max(spring, _LEAST_SPRING * stiffness)
    return BodyLoad(force - spring * depth.x, spring)


def _names(course: Course) -> list[str]:
    return [term.name for term in course.model.base.terms]


def _material(course: Course, theta: Vector) -> SpringDamper:
    """Return the spring and damper of the base, with k > 0 and b >= 0."""
    found = dict(zip(_names(course), theta.tolist(), strict=False))
    n, q = (course.power, course.power) if course.model.base.has_power else (1.0, 0.0)
    return SpringDamper(max(found["k"], 1e-9), n, max(found.get("b", 0.0), 0.0), q)


def _press(
    course: Course, joint: Joint, material: SpringDamper, load: BodyLoad, *, slopes: bool = False
) -> Matrix:
    """Return the force behind a joint, perhaps with its derivatives by k and b."""
    base, moved, clamped = course.model.base, course.moved, course.model.clamp != "none"
    speed = np.maximum(moved.v, 0.0) if base.name == "kelvin-voigt-unilateral" else moved.v
    return press_in_series(
        moved.x, speed, material, joint, moved.dt, load, clamped=clamped, slopes=slopes
    )
