"""Derivatives by a local polynomial (Savitzky and Golay), a zero-phase low-pass, a cubic spline.

scipy has all three, but loading scipy.signal and scipy.interpolate takes longer than a short
diagnosis, and its local polynomial is ill-conditioned where the window has a thousand samples.
"""

from __future__ import annotations

from math import perm

import numpy as np
import scipy

from teleop_rt.contact.effect import Vector

_WIDE = 64  # weights; wider windows are faster by spectra: 0.15 for 2.4 ms at 600, 10 000 samples


def local_polynomial(
    rows: Vector, half: int, order: int, derivative: int = 0, dt: float = 1.0
) -> Vector:
    """Return rows (..., samples) smoothed by a polynomial over 2 `half` + 1 samples, or derived.

    At the ends the polynomial of the first or the last window continues.
    """
    places = np.arange(-half, half + 1) / half
    powers = np.arange(order + 1)
    fitted = np.linalg.pinv(places[:, None] ** powers)
    lowered = np.maximum(powers - derivative, 0)
    factors = np.array([perm(power, derivative) for power in powers.tolist()])
    values = factors / (half * dt) ** derivative * places[:, None] ** lowered
    found, width = _correlated(rows, values[half] @ fitted), places.size
    found[..., :half] = rows[..., :width] @ fitted.T @ values[:half].T
    found[..., -half:] = rows[..., -width:] @ fitted.T @ values[-half:].T
    return np.asarray(found, dtype=np.float64)


def _correlated(rows: Vector, weights: Vector) -> Vector:
    """Return rows (..., samples) weighted by an odd number of weights about each sample.

    Half a window at both ends is undefined. By spectra, whose time hardly depends on the window.
    """
    if weights.size < _WIDE:
        return np.asarray(scipy.ndimage.correlate1d(rows, weights, axis=-1), dtype=np.float64)
    size, half = rows.shape[-1], weights.size // 2
    length = scipy.fft.next_fast_len(size + half, real=True)
    spectra = scipy.fft.rfft(rows, length) * scipy.fft.rfft(weights[::-1], length)
    found = scipy.fft.irfft(spectra, length, overwrite_x=True)[..., half : half + size]
    return np.asarray(found, dtype=np.float64)


def butterworth(row: Vector, cutoff_hz: float, dt: float) -> Vector:
    """Return the row filtered forward and backward by a Butterworth low-pass of 4th order.

    Its gain is that of the bilinear transform; at both ends the row continues, turned about them.
    """
    turned = 2.0 * row[[0, -1]][:, None] - row[::-1]
    whole = np.concatenate((turned[0, :-1], row, turned[1, 1:]))
    frequency = np.tan(np.pi * np.fft.rfftfreq(whole.size)) / np.tan(np.pi * cutoff_hz * dt)
    found = scipy.fft.irfft(scipy.fft.rfft(whole) / (1.0 + frequency**8), whole.size)
    return np.asarray(found[row.size - 1 : 2 * row.size - 1], dtype=np.float64)


def spline(places: Vector, t: Vector, row: Vector) -> Vector:
    """Return the natural cubic spline through a row of samples at increasing `t`, at `places`."""
    step = np.diff(t)
    slope = np.diff(row) / step
    bands = np.zeros((3, t.size))
    bands[1] = 1.0
    bands[0, 2:], bands[2, :-2] = step[1:], step[:-1]
    bands[1, 1:-1] = 2.0 * (step[1:] + step[:-1])
    bent = np.zeros(t.size)
    bent[1:-1] = 6.0 * np.diff(slope)
    bent = scipy.linalg.solve_banded((1, 1), bands, bent)
    i = np.clip(np.searchsorted(t, places, side="right") - 1, 0, t.size - 2)
    x, h = places - t[i], step[i]
    first = slope[i] - h * (2.0 * bent[i] + bent[i + 1]) / 6.0
    third = (bent[i + 1] - bent[i]) / (6.0 * h)
    return np.asarray(row[i] + x * (first + x * (0.5 * bent[i] + x * third)), dtype=np.float64)
