"""The level of the noise over time: it may grow with the force or with the speed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.noise.colours import Spectrum, positive_mixture

_STRETCH = 32  # samples, over which the level is even
_LEAST_GROWTH = 0.2  # of the power; a smaller part that grows is no difference


def level_of(residual: Vector, growing: Vector, used: NDArray[np.bool_]) -> Vector:
    """Return the deviation of the noise at each sample, over its root mean square.

    Its power is a constant and parts that grow with the square of each row of `growing` (rows,
    samples), by the third differences of the `residual`, which contain little else. Jumps are left
    out by the median of each stretch of the samples in use.
    """
    even = np.ones(residual.size)
    inside = used[:-3] & used[1:-2] & used[2:-1] & used[3:]
    number = int(np.count_nonzero(inside)) // _STRETCH
    rows = growing[np.any(growing[:, used] != 0.0, axis=1)]
    if number < 2 or not rows.size:
        return even
    squares = np.vstack([even, rows**2 / np.mean(rows[:, used] ** 2, axis=1, keepdims=True)])

    def stretches(row: Vector) -> NDArray[np.float64]:
        return row[inside][: number * _STRETCH].reshape(number, _STRETCH)

    power = np.median(np.abs(stretches(np.diff(residual, 3))), axis=1) ** 2
    if not np.all(power > 0.0):  # readings in steps larger than the noise
        return even
    shapes = np.array([np.mean(stretches(row[1:-2]), axis=1) for row in squares])
    share = positive_mixture(shapes, Spectrum(power, even[:number], np.zeros(number)))
    if np.sum(share[1:]) < _LEAST_GROWTH * np.sum(share):
        return even
    level = np.sqrt(share @ squares)
    return np.asarray(level / np.sqrt(np.mean(level[used] ** 2)))
