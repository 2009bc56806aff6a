"""Statistics of one row of samples: its noise, its steps, and stretches of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.contact.law import touches
from teleop_rt.diagnosis.samples.filters import pieces, running_rank

OUTLIERS = "outliers"  # name of the effect of isolated wrong samples
MAD_PER_DEVIATION = 0.6745  # median absolute deviation of a normal distribution of deviation 1
_GOLDEN = 0.6180339887498949  # multiples of it modulo 1 fill a step evenly
_GRID_SAMPLES = 200  # smallest differences that must lie on a grid of steps
_GRID_TOLERANCE = 0.05  # of a step; a reading in steps of a number has more
_LONE_SPREADS = 20.0  # times the range of its four neighbours: no tool moves that far and back
_LONE_RANGE = 1e-3  # of the row's range; a smaller jump is noise
_OUTLIER_SIGMAS = (
    8.0  # standard deviations of the noise; a sample farther from its neighbours is wrong
)
# Samples and s: a burst of errors. Longer, the force may be one that moves something.
_STEP_SAMPLES = 21  # around a sample, of which the usual step is taken
_STEP_RATIO = 2.0  # times that step; what a tool does changes as fast before and after
_LONGEST_BURST, _LONGEST_BURST_S = 4, 0.01
_APART_SAMPLES = (5, 7)  # more than a burst
_NOISE_SAMPLES = 101  # around a sample, of which the deviation is taken: many more than a burst
_OUTLIER_RATIO = 5.0  # times that deviation; noise reaches 4.5 once in 100 000 samples
_SURFACE_SAMPLES = 4  # samples from a crossing of the surface within which a jump is contact
_TOUCH_SPREAD = 0.1  # of the distance; beside one crossing, neighbours that agree show no contact

Stretch = tuple[int, int]
"""First sample, and first past the stretch."""


def stretches(chosen: NDArray[np.bool_]) -> list[Stretch]:
    """Return the stretches of consecutive chosen samples."""
    edges = np.diff(np.concatenate(([0], chosen.astype(np.int8), [0])))
    firsts, pasts = (np.flatnonzero(sign * edges > 0).tolist() for sign in (1, -1))
    return list(zip(firsts, pasts, strict=True))


def robust_deviation(values: Vector) -> float:
    """Return the standard deviation about 0 by the median, which outliers do not change."""
    return float(np.median(np.abs(values))) / MAD_PER_DEVIATION


def bulk(row: Vector) -> tuple[float, float]:
    """Return the quantiles of 1 and 99 %, between which a row lies but for outliers."""
    low, high = np.quantile(row, (0.01, 0.99)).tolist()
    return low, high


def force_noise(force: Vector, step: float | None = None) -> float:
    """Return the standard deviation of the force's fast noise, from third differences.

    Those of readings in steps lie on a grid, and so would their median, up to a third off: each is
    spread evenly over its step, and what that adds is subtracted. `step` [of the force] is that of
    its converter, found in the readings if it is not given.
    """
    third = np.diff(force, 3)
    third -= np.median(third)
    robust = robust_deviation(third)
    if robust > 0.0:
        step = quantisation_step(force) if step is None else step
        spread = robust_deviation(third + step * (np.arange(third.size) * _GOLDEN % 1.0 - 0.5))
        robust = float(np.sqrt(max(spread**2 - step**2 / 12.0, 0.0)))
    return (robust or float(np.std(third))) / float(np.sqrt(20.0))  # squares of the binomials


def quantisation_step(row: Vector) -> float:
    """Return the step of the readings if they lie on a grid, else 0."""
    distinct = np.unique(np.abs(np.diff(row)))
    distinct = distinct[distinct > 1e-12 * max(1.0, float(np.max(np.abs(row))))]
    if distinct.size == 0:
        return 0.0
    step = float(distinct[0])
    multiples: NDArray[np.float64] = distinct[:_GRID_SAMPLES] / step
    off = float(np.max(np.abs(multiples - np.round(multiples))))
    return step if off < _GRID_TOLERANCE else 0.0


def lone(row: Vector) -> NDArray[np.bool_]:
    """Return which samples lie far from two neighbours on either side: a slip of the reading.

    No tool is there for one sample, and derivatives would spread it over many.
    """
    found, least = np.zeros(row.size, dtype=np.bool_), _LONE_RANGE * np.ptp(row)
    for part in pieces(max(0, row.size - 4)):
        before2, before, at, after, after2 = (
            row[part.start + shift : part.stop + shift] for shift in range(5)
        )
        around = np.array([before2, before, after, after2])
        away, spread = np.abs(at - np.median(around, axis=0)), np.ptp(around, axis=0)
        found[part.start + 2 : part.stop + 2] = away > np.maximum(_LONE_SPREADS * spread, least)
    return found


def without_lone(row: Vector) -> Vector:
    """Return the row with lone samples on the line between their neighbours."""
    bad = lone(row)
    places = np.arange(row.size)
    return np.interp(places, places[~bad], row[~bad])


def _off_neighbours(row: Vector, length: int) -> tuple[Vector, Vector, Vector]:
    """Return how far `length` samples lie from two neighbours on either side, at the first of them.

    The nearest sample's distance from the neighbours' median, the range of the three of these that
    agree best (the fourth may be wrong itself), and the nearest sample's distance beyond all four,
    which at a corner of the row is none. What the row's slope does over the samples is taken off
    the first two. At the ends the row goes round.
    """
    places = np.array([-2, -1, length, length + 1])
    around = np.array([np.roll(row, -place) for place in places])
    inside = np.array([np.roll(row, -later) for later in range(length)])
    beyond = np.maximum(inside - around.max(axis=0), around.min(axis=0) - inside)
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


def outliers(force: Vector, x: Vector, noise: float, dt: float) -> Vector:
    """Return 1 for samples that stand alone, far from two neighbours on either side, else 0.

    Up to `_LONGEST_BURST_S` of them in a row. The neighbours must agree among themselves, and
    almost exactly where the tool crosses the surface beside them, so neither an impact nor a step
    is an outlier. Around them the row must be steadier, so neither a period of a tone nor the force
    of a fast reversal is one.
    """
    found = np.zeros(force.size, dtype=np.bool_)
    least = np.maximum(_OUTLIER_SIGMAS * noise, _OUTLIER_RATIO * _local_deviation(force))
    least = np.maximum(least, _STEP_RATIO * _usual_step(force))
    crossings = np.abs(np.diff(touches(x).astype(np.float64), prepend=float(touches(x[:1])[0])))
    beside = np.convolve(crossings, np.ones(2 * _SURFACE_SAMPLES + 1), mode="same")
    allowed = np.select([beside == 0.0, beside == 1.0], [0.5, _TOUCH_SPREAD], 0.0)
    for length in range(1, max(1, min(_LONGEST_BURST, int(_LONGEST_BURST_S / dt))) + 1):
        away, spread, beyond = _off_neighbours(force, length)
        first = (away > least) & (spread < allowed * away) & (away - beyond < allowed * away)
        for later in range(length):
            found |= np.roll(first, later)
    found[:_SURFACE_SAMPLES] = found[-_SURFACE_SAMPLES:] = False
    return np.asarray(found, dtype=np.float64)
