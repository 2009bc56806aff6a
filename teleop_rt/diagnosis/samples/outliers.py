"""Outliers: wrong samples of the force, alone or a few in a row."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.recordings.filters import running_rank
from teleop_rt.recordings.rows import MAD_PER_DEVIATION

OUTLIERS = "outliers"  # name of the effect
_OUTLIER_SIGMAS = 8.0  # deviations of the noise; a sample farther from its neighbours is wrong
_STEP_SAMPLES = 21  # around a sample, of which the usual step is taken
_STEP_RATIO = 2.0  # times that step; a tool's own motion changes as fast before and after
# Samples and s: a burst of errors. Longer, the force may be one that moves something.
_LONGEST_BURST, _LONGEST_BURST_S = 4, 0.01
_APART_SAMPLES = (5, 7)  # more than a burst
_NOISE_SAMPLES = 101  # around a sample, of which the deviation is taken: many more than a burst
_OUTLIER_RATIO = 5.0  # times that deviation; noise reaches 4.5 once in 100 000 samples
_LONGEST_DEAD_S = 0.1  # s; a longer stretch is a dropout (`dropouts.py`)
_BACK_RATIO = 0.5  # of the jump [1]; within it of its value before the jump, the force is back
_FEWEST_DEAD = 3  # stretches of one reading: a plateau of the force is held once
_SURFACE_SAMPLES = 4  # samples from a crossing of the surface within which a jump is contact
_TOUCH_SPREAD = 0.1  # of the distance; beside one crossing, neighbours that agree show no contact


def _off_neighbours(row: Vector, length: int) -> tuple[Vector, Vector, Vector]:
    """Return how far `length` samples lie from two neighbours on either side, at the first of them.

    The nearest sample's distance from the neighbours' median, the range of the three of these that
    agree best (the fourth may be wrong itself), and the nearest sample's distance beyond all but
    one of the outer two, which at a corner of the row is none. The change by the row's slope is
    subtracted from the first two. At the ends the row goes round.
    """
    places = np.array([-2, -1, length, length + 1])
    around = np.array([np.roll(row, -place) for place in places])
    inside = np.array([np.roll(row, -later) for later in range(length)])
    without_either = [
        np.maximum(inside - left.max(axis=0), left.min(axis=0) - inside)
        for left in (around[1:], around[:-1])
    ]
    beyond = np.max(without_either, axis=0)
    centred = places - places.mean()
    slope = centred @ around / (centred @ centred)
    around[2:] -= (length - 1) * slope
    inside -= np.multiply.outer(np.arange(length), slope)
    away = np.abs(inside - np.median(around, axis=0))
    around.sort(axis=0)
    spread = np.minimum(around[2] - around[0], around[3] - around[1])
    return away.min(axis=0), spread, beyond.min(axis=0)


def _local_deviation(row: Vector) -> Vector:
    """Return the deviation of the noise around each sample, from differences of distant samples.

    Of second differences, which have no slope, over more than a burst: a channel's filter leaves
    noise whose neighbours differ little, and a limit that cuts a part of the row leaves none there.
    A tone that one distance does not show is shown by the other.
    """
    apart = [np.abs(np.roll(row, far) - 2.0 * row + np.roll(row, -far)) for far in _APART_SAMPLES]
    middle = [running_rank(each, _NOISE_SAMPLES, 0.5) for each in apart]
    return np.asarray(np.max(middle, axis=0) / (MAD_PER_DEVIATION * 6.0**0.5), dtype=np.float64)


def _usual_step(row: Vector) -> Vector:
    """Return the step between samples that four in five around each sample do not exceed."""
    steps = np.abs(np.diff(row, prepend=row[:1]))
    return running_rank(steps, _STEP_SAMPLES, 0.8)


def _dead_readings(
    force: Vector, least: Vector, apart: NDArray[np.bool_], dt: float
) -> NDArray[np.bool_]:
    """Return whether each sample has a reading that the channel gives while it drops out.

    The force jumps to one and the same reading, holds it, and jumps back to where it was, at three
    places or more that are `apart` from a touch. Each jump is larger than `least`. A plateau that
    the force reaches otherwise is none.
    """
    firsts = np.flatnonzero(np.diff(force, prepend=np.nan) != 0.0)[1:]
    pasts = np.append(firsts[1:], force.size)
    firsts, pasts = firsts[:-1], pasts[:-1]  # the row begins and ends in a stretch of its own
    before, reading, after = force[firsts - 1], force[firsts], force[pasts]
    into, out = before - reading, after - reading
    jumps = np.sign(into) * np.sign(out) * np.minimum(np.abs(into), np.abs(out))
    back = np.abs(after - before) < np.maximum(_BACK_RATIO * jumps, 0.0)
    dead = (jumps > least[firsts]) & back & ((pasts - firsts) * dt <= _LONGEST_DEAD_S)
    dead &= apart[firsts] & apart[pasts]
    values, times = np.unique(reading[dead], return_counts=True)
    dead &= np.isin(reading, values[times >= _FEWEST_DEAD])
    found = np.zeros(force.size, dtype=np.bool_)
    for first, past in zip(firsts[dead].tolist(), pasts[dead].tolist(), strict=True):
        found[first:past] = True
    return found


def outliers(force: Vector, x: Vector, noise: float, dt: float) -> Vector:
    """Return 1 for samples that stand alone, far from two neighbours on either side, else 0.

    Up to `_LONGEST_BURST_S` of them in a row, or all that give the reading of a dead channel. The
    neighbours must agree among themselves, and almost exactly where the tool crosses the surface
    beside them, so neither an impact nor a step is an outlier. Around them the row must be
    steadier, so neither a period of a tone nor the force of a fast reversal is one.
    """
    least = np.maximum(_OUTLIER_SIGMAS * noise, _OUTLIER_RATIO * _local_deviation(force))
    least = np.maximum(least, _STEP_RATIO * _usual_step(force))
    crossings = np.abs(np.diff(touches(x).astype(np.float64), prepend=float(touches(x[:1])[0])))
    beside = np.convolve(crossings, np.ones(2 * _SURFACE_SAMPLES + 1), mode="same")
    found = _dead_readings(force, least, beside == 0.0, dt)
    if np.any(found):  # good samples between two dead stretches are no burst
        places = np.arange(force.size)
        force = np.interp(places, places[~found], force[~found])
    allowed = np.select([beside == 0.0, beside == 1.0], [0.5, _TOUCH_SPREAD], 0.0)
    for length in range(1, max(1, min(_LONGEST_BURST, int(_LONGEST_BURST_S / dt))) + 1):
        away, spread, beyond = _off_neighbours(force, length)
        first = (away > least) & (spread < allowed * away) & (away - beyond < allowed * away)
        for later in range(length):
            found |= np.roll(first, later)
    found[:_SURFACE_SAMPLES] = found[-_SURFACE_SAMPLES:] = False
    return np.asarray(found, dtype=np.float64)
