"""Detection of lost contact: samples beyond the surface at which the tool does not touch.

Contact pushes and does not pull. A slow, worn or hysteretic body releases the tool while the tool
is still beyond the surface, and touches it again deeper than the first time. In between, the force
is that of free air, so these samples contain no information about a contact law.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.recordings.rows import Stretch, robust_deviation, stretches

_SIGMAS = 5.0  # standard deviations of the noise within which a force is that of free air
_FREE_SAMPLES = 20  # samples of free air whose median is its force
FEWEST_FREE_SAMPLES = 5  # of free air or of a stretch; fewer are left to chance
_WANDER_OCTAVES = 3  # lags, each twice the last, over which the force of free air may drift
_WANDER_LAGS = 3  # pairs of samples over a lag, in lags; fewer do not show the drift
_BIASED_SAMPLES = 1  # beside a stretch: its noise decided where the stretch ends
_LOWEST_QUANTILE = 0.005  # of the force: readings that a lost contact leaves at zero
_ZERO_LEVEL_RATIO = 0.25  # of the force's range; a lowest force farther from 0 is no free air
_LARGEST_WANDER = 0.02  # of the force's range; a larger drift is a force of the tool


def without_contact(
    force: Vector, x: Vector, v: Vector, noise: float, fewest: int = FEWEST_FREE_SAMPLES
) -> Vector:
    """Return 1 for samples beyond the surface at which the tool did not touch, else 0.

    x and v are penetration and velocity, `noise` the standard deviation of the force's fastest
    part; where the force of free air wanders by more than that, the wander counts. These are
    stretches that show the force of free air: from the surface on, as just before it, or begun in
    withdrawal, as after the withdrawal that is nearest in time; friction differs by direction.

    The sample that ends a stretch was chosen for its noise, which pushed it over the bar: it counts
    as without_contact, too, or every touch would add to a force that is not there.
    """
    found = np.zeros(x.size)
    inside = touches(x)
    # A heavy tool's force in free air may be that of contact, and does not show its loss.
    noise = max(noise, min(_wander(force, inside), _LARGEST_WANDER * float(np.ptp(force))))
    entered, before = _free_levels(force[::-1], inside[::-1])
    outside = np.append(np.flatnonzero(~inside), x.size)
    for start, level in zip((x.size - entered).tolist(), before, strict=True):
        end = int(outside[np.searchsorted(outside, start)])
        felt = np.abs(force[start:end] - level) >= _SIGMAS * noise
        found[
            start : min(start + int(np.argmax(felt)) + _BIASED_SAMPLES, end) if felt.any() else end
        ] = 1.0
    left, after = _free_levels(force, inside)
    if left.size:
        nearest = np.searchsorted(0.5 * (left[:-1] + left[1:]), np.arange(x.size))
        free = inside & (np.abs(force - after[nearest]) < _SIGMAS * noise)
        lost = _withdrawn(free, v, fewest)
    else:
        lost = _at_lowest_force(force, x, v, noise, fewest) if inside.all() else []
    for first, past in lost:
        found[max(first - _BIASED_SAMPLES, 0) : past + _BIASED_SAMPLES] = 1.0
    return np.where(inside, found, 0.0)


def _withdrawn(free: NDArray[np.bool_], v: Vector, fewest: int) -> list[Stretch]:
    """Return first and past of each stretch of free samples that begins in withdrawal."""
    return [(a, b) for a, b in stretches(free) if b - a >= fewest and v[a] < 0.0]


def _at_lowest_force(
    force: Vector, x: Vector, v: Vector, noise: float, fewest: int
) -> list[Stretch]:
    """Return the stretches of lost contact of a tool that never leaves the surface.

    Lost contact shows as the lowest force, near the sensor's zero, and independent of the motion.
    In at least one stretch the tool must withdraw so far that a body in contact would change the
    force, and return some way, while the force stays constant. The friction of a guide would change
    the force at the reversal; such a stretch is free air before the surface.
    """
    lowest = force < np.quantile(force, _LOWEST_QUANTILE) + _SIGMAS * noise
    level = float(np.median(force[lowest]))
    if abs(level) > _ZERO_LEVEL_RATIO * float(np.ptp(force)):
        return []
    lost = _withdrawn(np.abs(force - level) < _SIGMAS * noise, v, fewest)
    stiffness = float(np.ptp(force)) / max(float(np.ptp(x)), 1e-300)

    def flat(first: int, past: int) -> bool:
        way, felt = x[first:past], force[first:past]
        if stiffness * (way[-1] - np.min(way)) < _SIGMAS * noise:
            return False
        far = way <= 0.5 * (np.min(way) + np.max(way))
        way, felt = way[far] - np.mean(way[far]), felt[far]
        size = float(np.ptp(way))
        if way.size < _FREE_SAMPLES or stiffness * size < 2.0 * _SIGMAS * noise:
            return False
        return abs(float(way @ felt) / float(way @ way)) * size < noise

    return lost if any(flat(*stretch) for stretch in lost) else []


def _wander(force: Vector, inside: NDArray[np.bool_]) -> float:
    """Return the standard deviation of the drift of free-air force during a withdrawal."""
    lags = [_FREE_SAMPLES * 2**i for i in range(_WANDER_OCTAVES)]
    found = [0.0]
    for lag in (lag for lag in lags if lag < inside.size):
        apart = ~inside[lag:] & ~inside[:-lag]
        if np.count_nonzero(apart) >= _WANDER_LAGS * lag:
            change = (force[lag:] - force[:-lag])[apart]
            found.append(robust_deviation(change) / np.sqrt(2.0))
    return max(found)


def _free_levels(force: Vector, inside: NDArray[np.bool_]) -> tuple[NDArray[np.int64], Vector]:
    """Return the samples at which the tool left the surface, and the free-air force after each."""
    crossings, levels = [], []
    for crossing in np.flatnonzero(inside[:-1] & ~inside[1:]) + 1:
        after = inside[crossing : crossing + _FREE_SAMPLES]
        free = int(np.argmax(after)) if after.any() else after.size
        if free >= FEWEST_FREE_SAMPLES:
            crossings.append(int(crossing))
            levels.append(float(np.median(force[crossing : crossing + free])))
    return np.array(crossings, dtype=np.int64), np.array(levels)
