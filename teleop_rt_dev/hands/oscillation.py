"""The campaign's definition of an oscillation of a handle, independent of the product's."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

Array = NDArray[np.float64]

SWING, FORCE, LOWEST_HZ, HIGHEST_HZ = 0.2e-3, 0.5, 3.0, 40.0
SUSTAINED = 5
"""Swings in a row that do not decay."""
IDEAL_SHARE = 0.8
"""A hand that makes swings of this size against an ideal wall makes those that were seen."""
KEPT = 0.95
"""A swing that is smaller than this share of the one before the last decays."""


def turns(position: Array) -> NDArray[np.int64]:
    """Return where a motion turns round by more than SWING, in order."""
    tops, _ = find_peaks(position, prominence=SWING, plateau_size=1)
    bottoms, _ = find_peaks(-position, prominence=SWING, plateau_size=1)
    return np.sort(np.concatenate((tops, bottoms)))


@dataclass(frozen=True)
class Swings:
    """Swings in a row: how many, how large, how fast, and when they began and ended."""

    swings: int
    size_m: float
    hz: float
    begins_s: float
    ends_s: float


def rows_of(
    position: Array, force: Array, period_s: float, given_J: Array | None = None
) -> list[Swings]:
    """Return the rows of swings that do not decay, each again with every swing that it grows by.

    Counted are swings of 3 to 40 Hz above 0.2 mm with a force that changes by more than 0.5 N. With
    `given_J`, the energy that the hand has given to the device, only those count over which, with
    the swing before, it gave none: a trembling hand works, a hand that is shaken does not.
    """
    at = turns(position)
    found, row, before = list[Swings](), list[float](), (0.0, 0.0)
    for index, (begin, end) in enumerate(pairwise(at)):
        size = abs(float(position[end] - position[begin]))
        fast = 0.5 / HIGHEST_HZ <= (end - begin) * period_s <= 0.5 / LOWEST_HZ
        felt = float(np.ptp(force[begin : end + 1])) > FORCE
        shaken = given_J is None or work(position, force, given_J, at[max(0, index - 1)], end) <= 0
        if not (fast and felt and size > SWING and shaken):
            row, before = [], (0.0, 0.0)
            continue
        row = [*row, size] if size >= KEPT * before[0] else [size]
        before = before[1], size
        begins_s, ends_s = at[index + 1 - len(row)] * period_s, end * period_s
        hz = 0.5 * len(row) / (ends_s - begins_s)
        found.append(Swings(len(row), float(np.median(row)), hz, begins_s, ends_s))
    return found


def longest_oscillation(
    position: Array, force: Array, period_s: float, given_J: Array | None = None
) -> tuple[int, float]:
    """Return the most swings in a row that do not decay, and their median size: see `rows_of`."""
    found = rows_of(position, force, period_s, given_J)
    longest = max(found, key=lambda row: row.swings, default=None)
    return (0, 0.0) if longest is None else (longest.swings, longest.size_m)


def work(position: Array, force: Array, given_J: Array, begin: int, end: int) -> float:
    """Return a hand's work between two turns, less the energy that the wall's spring gained."""
    span = slice(begin, end + 1)
    stiffness = float(np.ptp(force[span]) / max(np.ptp(position[span]), SWING))
    if stiffness <= 0.0:
        return float(given_J[end] - given_J[begin])
    stored = 0.5 * (force[end] ** 2 - force[begin] ** 2) / stiffness
    return float(given_J[end] - given_J[begin] - stored)
