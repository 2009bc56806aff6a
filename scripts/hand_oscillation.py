"""What counts as an oscillation of a handle: the campaign's own measure, shared with no product."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

Array = NDArray[np.float64]

SWING, FORCE, LOWEST_HZ, HIGHEST_HZ = 0.2e-3, 0.5, 3.0, 40.0
KEPT = 0.95
"""A swing that is smaller than this share of the one before the last decays."""


def turns(position: Array) -> NDArray[np.int64]:
    """Return where a motion turns round by more than SWING, in order."""
    tops, _ = find_peaks(position, prominence=SWING, plateau_size=1)
    bottoms, _ = find_peaks(-position, prominence=SWING, plateau_size=1)
    return np.sort(np.concatenate((tops, bottoms)))


def longest_oscillation(position: Array, force: Array, period_s: float) -> tuple[int, float]:
    """Return the most swings in a row that do not decay, and the largest of them.

    Counted are swings of 3 to 40 Hz above 0.2 mm with a force that changes by more than 0.5 N.
    """
    at = turns(position)
    most, largest, row, sizes = 0, 0.0, 0, [0.0, 0.0]
    for begin, end in pairwise(at):
        size = abs(float(position[end] - position[begin]))
        fast = 0.5 / HIGHEST_HZ <= (end - begin) * period_s <= 0.5 / LOWEST_HZ
        felt = float(np.ptp(force[begin : end + 1])) > FORCE
        if not (fast and felt and size > SWING):
            row, sizes = 0, [0.0, 0.0]
            continue
        row = row + 1 if size >= KEPT * sizes[0] else 1
        sizes = [sizes[1], size]
        if row > most:
            most, largest = row, size
    return most, largest
