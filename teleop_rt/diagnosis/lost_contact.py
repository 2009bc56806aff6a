"""Where the tool is beyond the surface and yet does not touch.

Contact pushes and does not pull: a body that is slow, worn or hysteretic lets go of the tool while
the tool is still beyond the surface, and is met again deeper than it was at first. In between the
force is that of free air, whatever a law that is written for contact says; these samples tell
nothing of the law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector

_SIGMAS = 5.0
_FREE_SAMPLES = 20
_LEAST = 5
_OCTAVES = 3
_ENOUGH = 3
_CHOSEN = 3


def untouched(force: Vector, x: Vector, v: Vector, noise: float) -> Vector:
    """Return 1 for samples beyond the surface at which the tool did not touch, else 0.

    x and v are penetration and velocity, `noise` the standard deviation of the force's fastest
    part; where the force of free air wanders by more than that, the wander counts. These are
    stretches that show the force of free air: from the surface on, as just before it, or begun in
    withdrawal, as after the withdrawal that is nearest in time; friction differs by direction.

    The sample that ends a stretch was chosen for its noise, which pushed it over the bar, and what
    is next to it for noise that lasts: a few count as untouched, too, or every touch would add to
    a force that is not there.
    """
    found = np.zeros(x.size)
    inside = x > 0.0
    noise = max(noise, _wander(force, inside))
    entered, before = _free_levels(force[::-1], inside[::-1])
    outside = np.append(np.flatnonzero(~inside), x.size)
    for start, level in zip((x.size - entered).tolist(), before, strict=True):
        end = int(outside[np.searchsorted(outside, start)])
        felt = np.abs(force[start:end] - level) >= _SIGMAS * noise
        found[start : min(start + int(np.argmax(felt)) + _CHOSEN, end) if felt.any() else end] = 1.0
    left, after = _free_levels(force, inside)
    if left.size:
        nearest = np.searchsorted(0.5 * (left[:-1] + left[1:]), np.arange(x.size))
        free = inside & (np.abs(force - after[nearest]) < _SIGMAS * noise)
        edges = np.diff(np.concatenate(([0], free.astype(np.int8), [0])))
        for first, past in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True):
            if past - first >= _LEAST and v[first] < 0.0:
                found[max(first - _CHOSEN, 0) : past + _CHOSEN] = 1.0
    return np.where(inside, found, 0.0)


def _wander(force: Vector, inside: NDArray[np.bool_]) -> float:
    """Return how far the force of free air goes, as a deviation, in the time of a withdrawal."""
    lags = [_FREE_SAMPLES * 2**i for i in range(_OCTAVES)]
    found = [0.0]
    for lag in (lag for lag in lags if lag < inside.size):
        apart = ~inside[lag:] & ~inside[:-lag]
        if np.count_nonzero(apart) >= _ENOUGH * lag:
            change = np.abs(force[lag:] - force[:-lag])[apart]
            found.append(float(np.median(change)) / 0.6745 / np.sqrt(2.0))
    return max(found)


def _free_levels(force: Vector, inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Vector]:
    """Return where the tool came out of the surface, and the force of the air just after."""
    crossings, levels = [], []
    for crossing in np.flatnonzero(inside[:-1] & ~inside[1:]) + 1:
        after = inside[crossing : crossing + _FREE_SAMPLES]
        free = int(np.argmax(after)) if after.any() else after.size
        if free >= _LEAST:
            crossings.append(int(crossing))
            levels.append(float(np.median(force[crossing : crossing + free])))
    return np.array(crossings, dtype=np.int64), np.array(levels)
