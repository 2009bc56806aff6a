"""Statistics of one row of samples: its noise, its steps, and stretches of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.recordings.filters import pieces

MAD_PER_DEVIATION = 0.6745  # median absolute deviation of a normal distribution of deviation 1
_GOLDEN = 0.6180339887498949  # multiples of it modulo 1 fill a step evenly
_GRID_SAMPLES = 200  # smallest differences that must lie on a grid of steps
_GRID_TOLERANCE = 0.05  # of a step; a reading in steps of a number has more
_LONE_SPREADS = 20.0  # times the range of its four neighbours: no tool moves that far and back
_LONE_RANGE = 1e-3  # of the row's range; a smaller jump is noise

Stretch = tuple[int, int]
"""First sample, and first past the stretch."""


def stretches(chosen: NDArray[np.bool_]) -> list[Stretch]:
    """Return the stretches of consecutive chosen samples."""
    outside = np.zeros(1, np.int8)
    edges = np.diff(np.concatenate((outside, chosen.astype(np.int8), outside)))
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
    spread evenly over its step, and its variance is subtracted. `step` [of the force] is that of
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
    steps = np.diff(row)  # of an hour at 1 kHz 29 MB, worked on in place
    np.abs(steps, out=steps)
    steps.sort()
    least = 1e-12 * max(1.0, float(np.max(row)), -float(np.min(row)))
    steps = steps[np.searchsorted(steps, least, side="right") :]
    if steps.size == 0:
        return 0.0
    step = float(steps[0])
    rises = np.flatnonzero(steps[1:] > steps[:-1])[: _GRID_SAMPLES - 1]
    multiples: NDArray[np.float64] = steps[np.append(0, rises + 1)] / step
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
