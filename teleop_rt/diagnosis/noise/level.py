"""The level of the noise over time: that of a sensor or drive may grow with its force."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.noise.colours import Spectrum, positive_mixture

_STRETCH = 32  # samples, over which the level is even
_LEAST_GROWTH = 0.2  # of the power; a smaller part that grows is no difference


def level_of(residual: Vector, force: Vector, used: NDArray[np.bool_]) -> Vector:
    """Return the deviation of the noise at each sample, over its root mean square.

    Its power is a constant and a part that grows with the square of the model's `force`, by the
    third differences of the `residual`, which contain little else. Jumps are left out by the median
    of each stretch of the samples in use.
    """
    even = np.ones(force.size)
    inside = used[:-3] & used[1:-2] & used[2:-1] & used[3:]
    number = int(np.count_nonzero(inside)) // _STRETCH
    mean = float(np.mean(force[used] ** 2)) if np.any(used) else 0.0
    if number < 2 or mean == 0.0:
        return even

    def stretches(row: Vector) -> NDArray[np.float64]:
        return row[inside][: number * _STRETCH].reshape(number, _STRETCH)

    power = np.median(np.abs(stretches(np.diff(residual, 3))), axis=1) ** 2
    squares = np.mean(stretches(force[1:-2] ** 2), axis=1) / mean
    if not np.all(power > 0.0):  # readings in steps larger than the noise
        return even
    shapes = np.vstack([np.ones(number), squares])
    steady, growing = positive_mixture(shapes, Spectrum(power, even[:number], np.zeros(number)))
    if growing < _LEAST_GROWTH * (steady + growing):
        return even
    level = np.sqrt(steady + growing * force**2 / mean)
    return np.asarray(level / np.sqrt(np.mean(level[used] ** 2)))
