"""Derivatives by a local polynomial (Savitzky and Golay), low-passes, ranks.

scipy has them, but loading it takes longer than a short diagnosis, and its local polynomial is
ill-conditioned where the window has a thousand samples.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import perm

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import kernel

_FAST = np.unique(
    [2**i * 3**j * 5**k for i in range(32) for j in range(20) for k in range(14)
     if 2**i * 3**j * 5**k < 2**32]
)  # fmt: skip
"""Lengths of fast Fourier transforms: their largest prime factor is 5."""

_AT_ONCE = 100_000
"""Samples worked on together where a step between takes several times their memory."""


def pieces(size: int) -> Iterator[slice]:
    """Give the places of `size` samples piece by piece: the computation of each needs no others.

    Of an hour at 1 kHz every row that is made on the way would take 29 MB.
    """
    for first in range(0, size, _AT_ONCE):
        yield slice(first, min(first + _AT_ONCE, size))


def fast_length(least: int) -> int:
    """Return the smallest fast length of a Fourier transform of `least` values or more."""
    return int(_FAST[np.searchsorted(_FAST, least)])


def fast_length_within(most: int) -> int:
    """Return the largest fast length of a Fourier transform of `most` values or fewer."""
    return int(_FAST[np.searchsorted(_FAST, most, side="right") - 1])


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
    size, half = rows.shape[-1], weights.size // 2
    length = fast_length(size + half)
    spectra = np.fft.rfft(rows, length) * np.fft.rfft(weights[::-1], length)
    return np.fft.irfft(spectra, length)[..., half : half + size]


def gaussian(row: Vector, deviation: float, reach: int) -> Vector:
    """Return the row smoothed by a Gaussian of that deviation and reach [samples].

    Beyond its ends the row stays as it is there.
    """
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    longer = np.pad(row, reach, mode="edge")
    return _correlated(longer, weights / weights.sum())[reach:-reach]


def running_rank(row: Vector, width: int, share: float) -> Vector:
    """Return the value that a share of the `width` samples (odd) about each one does not exceed.

    0 is the least, 0.5 the median, 1 the largest. At its ends the row is mirrored.
    """
    longer = np.pad(row, width // 2, mode="symmetric")
    found = np.empty_like(row)
    _running_rank(longer, min(int(share * width), width - 1), np.sort(longer[:width]), found)
    return found


@kernel
def _running_rank(row: Vector, rank: int, window: Vector, out: Vector) -> None:
    """Take one sample out of the sorted `window`, and the next one in."""
    out[0] = window[rank]
    last = window.size - 1
    for i in range(1, out.size):
        place = min(np.searchsorted(window, row[i - 1]), last)
        fresh = row[i + last]
        while place < last and window[place + 1] < fresh:
            window[place] = window[place + 1]
            place += 1
        while place > 0 and window[place - 1] > fresh:
            window[place] = window[place - 1]
            place -= 1
        window[place] = fresh
        out[i] = window[rank]


def butterworth(row: Vector, cutoff_hz: float, dt: float) -> Vector:
    """Return the row filtered forward and backward by a Butterworth low-pass of 4th order.

    Its gain is that of the bilinear transform; at both ends the row continues, turned about them.
    """
    turned = 2.0 * row[[0, -1]][:, None] - row[::-1]
    whole = np.concatenate((turned[0, :-1], row, turned[1, 1:]))
    frequency = np.tan(np.pi * np.fft.rfftfreq(whole.size)) / np.tan(np.pi * cutoff_hz * dt)
    found = np.fft.irfft(np.fft.rfft(whole) / (1.0 + frequency**8), whole.size)
    return found[row.size - 1 : 2 * row.size - 1]
