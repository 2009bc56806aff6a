"""Noise: its spectrum from a residual, and the filter that makes it white (after Whittle)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from teleop_rt.contact.effect import Vector

Matrix = NDArray[np.float64]
BAND_HZ = 250.0
_CLIP = 5.0
_MAX_DEGREE = 4
_SUPPORT = 8.0


@dataclass(frozen=True)
class Whitener:
    """Takes rows of samples to the frequency domain, where the noise has variance 1.

    `mask` (0 to 1) leaves out samples; `density` is the noise power of each kept bin. Real and
    imaginary parts stand side by side, so scalar products are those of real vectors. Spectra need
    no model order, and reach 1/f noise down to the lowest bin.
    """

    mask: Vector
    density: Vector

    @property
    def bins(self) -> int:
        """Number of frequency bins kept."""
        return int(self.density.size)

    @property
    def effective(self) -> float:
        """Number of independent values in the band that the mask leaves."""
        return 2.0 * self.bins * float(np.mean(self.mask))

    def spectra(self, rows: Matrix) -> NDArray[np.complex128]:
        """Return the kept bins of masked rows."""
        found: NDArray[np.complex128] = fft.rfft(rows * self.mask, axis=-1)[..., : self.bins]
        return found

    def __call__(self, rows: Matrix) -> Matrix:
        """Return whitened rows, twice as many values as bins."""
        scaled = self.spectra(rows) * np.sqrt(2.0 / self.density)
        scaled[..., 0] /= np.sqrt(2.0)
        return np.concatenate([scaled.real, scaled.imag], axis=-1)


def band_bins(samples: int, dt: float) -> int:
    """Return how many bins lie below the band's edge: 250 Hz, or 0.4 of the rate."""
    edge = min(BAND_HZ, 0.4 / dt)
    return int(edge * dt * samples)


def white(mask: Vector, deviation: float, dt: float) -> Whitener:
    """Return a whitener for white noise of a known standard deviation."""
    bins = band_bins(mask.size, dt)
    return Whitener(mask, np.full(bins, deviation**2 * float(np.sum(mask**2))))


def estimate(spectrum: NDArray[np.complex128], whitener: Whitener, leverage: Vector) -> Whitener:
    """Return a whitener for the noise whose spectrum a fit has left.

    `leverage` (per bin, 0 to 1) is the share of the noise that the fit has taken away. The
    logarithm of the density is a polynomial in log frequency, its degree by BIC: a constant for
    white noise, a slope for 1/f, a knee for autoregressive noise; narrow lines are clipped, for
    they are signals.
    """
    power = np.abs(spectrum) ** 2 / np.maximum(1.0 - leverage, 0.05)
    weight = np.maximum(1.0 - leverage, 0.02)
    # Below the bins that a fit has eaten the density is held: a polynomial must not extrapolate.
    first = int(np.searchsorted(np.cumsum(weight), _SUPPORT))
    place = np.log(1.0 + np.maximum(np.arange(whitener.bins), first))
    place = 2.0 * (place - place[0]) / (place[-1] - place[0]) - 1.0
    best, best_score = np.full(whitener.bins, float(np.mean(power))), np.inf
    for degree in range(_MAX_DEGREE + 1):
        design = np.polynomial.chebyshev.chebvander(place, degree)
        density = _gamma_regression(design, power, weight)
        ratio = np.minimum(power / density, 2 * _CLIP)
        score = 2.0 * float(np.sum(weight * (np.log(density) + ratio)))
        score += (degree + 1) * np.log(whitener.bins)
        if score < best_score:
            best, best_score = density, score
    return Whitener(whitener.mask, best)


def _gamma_regression(design: Matrix, power: Vector, weight: Vector) -> Vector:
    """Fit exponentially distributed power with a log-linear mean; clipped against lines."""
    start = np.log(np.maximum(power, 1e-300)) + np.euler_gamma
    beta = np.linalg.lstsq(design * weight[:, None], start * weight, rcond=None)[0]
    # The mean of min(E, clip) for a unit exponential E, so that clipping does not bias.
    mean = 1.0 - np.exp(-_CLIP)
    gram = design.T @ (design * weight[:, None])
    for _ in range(15):
        level = design @ beta
        excess = np.minimum(power * np.exp(-level), _CLIP) / mean - 1.0
        step = np.linalg.solve(gram, design.T @ (weight * excess))
        beta = beta + np.clip(step, -1.0, 1.0)
        if float(np.max(np.abs(step))) < 1e-4:
            break
    return np.asarray(np.exp(design @ beta), dtype=np.float64)
