"""Slow noise in a recording that does not end where it began.

A spectrum assumes a periodic recording. Red noise is not periodic: its drift from the first sample
to the last is a jump in the periodic continuation, and its power along a drift is ten times (1/f
noise) to a thousand times (a random walk) that of its spectrum.
"""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.recordings.rows import Stretch, stretches

_DEGREE = 3  # of the polynomials along which a record does not end where it began
_LONG_HOLE, _MOST_HOLES = 0.01, 4  # of the record; the longest such holes get a step each
_LENGTH_FACTOR = 4  # times as long, for a spectrum that is not periodic over the record
_LEAST_EXCESS = 0.05  # of the variance; a smaller excess is not corrected


def rows(mask: Vector) -> Matrix:
    """Return the slowest rows of a recording (rows, samples): polynomials, and steps in long holes.

    A long stretch that `mask` leaves out divides the recording in two, with an offset by red noise.
    """
    time = np.linspace(-1.0, 1.0, mask.size)
    longest = sorted(inner_holes(mask), key=lambda hole: hole[0] - hole[1])[:_MOST_HOLES]
    begun = [first for first, past in longest if past - first > _LONG_HOLE * mask.size]
    steps = [np.sign(time - time[first]) for first in begun]
    polynomials = np.polynomial.legendre.legvander(time, _DEGREE).T
    return np.concatenate([polynomials, np.array(steps).reshape(-1, mask.size)])


def inner_holes(mask: Vector) -> list[Stretch]:
    """Return the stretches that `mask` leaves out between two samples that it keeps."""
    return [hole for hole in stretches(mask <= 0.0) if hole[0] > 0 and hole[1] < mask.size]


def finer(density: Vector, size: int, longer: int) -> Vector:
    """Return the density at the bins of a recording so many times as long, up to its half rate.

    Below the lowest bin it rises as it does there, at most like 1/f; above the band it is flat.
    """
    place = np.arange(longer * size // 2 + 1) / longer
    bins = np.arange(density.size)
    found = np.interp(place, bins, density)
    low = place < 1.0
    slope = np.clip(np.log2(density[1] / density[2]), 0.0, 1.0)
    found[low] = density[1] * np.maximum(place[low], 0.5 / longer) ** -slope
    return np.asarray(found, dtype=np.float64)


def excess(
    whitened: Matrix, scale: Vector, density: Vector, mask: Vector
) -> tuple[Matrix, Vector] | None:
    """Return directions (columns) with excess noise, and the share to subtract along each.

    `whitened` are slow rows, whitened by `scale` as if periodic; `density` is the noise power per
    bin. The covariance of noise along them is that of a stationary process. None where there are
    no such directions.
    """
    size, bins = mask.size, density.size
    if 2 * bins <= whitened.shape[0]:
        return None
    basis, _ = np.linalg.qr(whitened.T)
    spectrum = np.zeros((basis.shape[1], size // 2 + 1), dtype=np.complex128)
    spectrum[:, :bins] = (basis[:bins] + 1j * basis[bins:]).T * scale
    spectrum[:, 1:] *= 0.5
    back = mask * np.fft.irfft(spectrum, size) * size
    seen = np.fft.rfft(back, _LENGTH_FACTOR * size)
    power = finer(density, size, _LENGTH_FACTOR) / size
    power[1:] *= 2.0
    covariance = (seen * power @ seen.conj().T).real / (_LENGTH_FACTOR * size)
    variance, turned = np.linalg.eigh(covariance)
    loud = variance > 1.0 + _LEAST_EXCESS
    if not np.any(loud):
        return None
    return basis @ turned[:, loud], 1.0 - 1.0 / np.sqrt(variance[loud])
