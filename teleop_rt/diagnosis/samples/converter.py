"""Correction of a coarse converter's force where the sensor's noise determines it.

The mean reading of a force between two steps of the converter is nearer to one of the steps. If
the noise is smaller than about a step, this error repeats at each rest and appears as a ripple of
the force (Widrow and Kollar, Quantization Noise, 2008, ch. 9).
"""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.recordings.filters import local_polynomial

_HARMONICS = np.arange(1, 9)  # of the mean error over a step; noise suppresses higher ones
_HIDDEN_STEP_RATIO = 1.2  # of the noise; smaller steps leave no mean error to correct
_LEAST_NOISE_STEPS = 0.05  # of a step: the least noise, so that the mean error stays smooth
_TABLE_SIZE = 401  # points of the inverse over one step


def without_steps(force: Vector, half: int, step: float) -> Vector:
    """Return the force without the mean error of the `step` in which it was read.

    `half` is half the width [samples] of a window in which the force changes little. A force
    without steps, or with steps hidden by the noise, is returned unchanged.
    """
    if step <= 0.0:
        return force
    smooth = local_polynomial(force, half, 3)
    scatter = _scatter(force - smooth, 2 * half + 1)
    noise = before_steps(scatter, step)
    if step < _HIDDEN_STEP_RATIO * noise:
        return force
    places = np.linspace(-0.5, 0.5, _TABLE_SIZE) * step
    read = places + mean_error(places, step, noise)
    whole = step * np.round(smooth / step)
    true = whole + np.interp(smooth - whole, read, places)
    return np.asarray(force - mean_error(true, step, noise), dtype=np.float64)


def before_steps(noise: float, step: float) -> float:
    """Return the deviation of the noise before a converter's steps, from that after them."""
    return float(np.sqrt(max(noise**2 - step**2 / 12.0, (_LEAST_NOISE_STEPS * step) ** 2)))


def _scatter(rest: Vector, width: int) -> float:
    """Return the median standard deviation within a window; lively windows have no influence.

    The factor corrects for the noise that the window's polynomial removed.
    """
    blocks = rest[: rest.size // width * width].reshape(-1, width)
    return float(np.sqrt(np.median(np.mean(blocks**2, axis=1)) / (1.0 - 2.25 / width)))


def mean_error(force: Vector, step: float, noise: float) -> Vector:
    """Return the mean over the noise of reading minus force."""
    k = _HARMONICS[:, None]
    weights = (-1.0) ** k / k * np.exp(-2.0 * (np.pi * k * noise / step) ** 2)
    found = step / np.pi * np.sum(weights * np.sin(2.0 * np.pi * k * force / step), axis=0)
    return np.asarray(found, dtype=np.float64)
