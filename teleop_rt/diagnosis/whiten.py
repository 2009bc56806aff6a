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
_UPDATES = 400
_GROUPS = 60
_SUPPORT = 8.0
_POWERS = (0.5, 1.0, 1.5, 2.0)
# No lower corner: where a fit has eaten the low bins, a flat bottom there would be a guess.
_CORNERS_HZ = (15.0, 50.0)


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


def estimate(
    spectrum: NDArray[np.complex128], whitener: Whitener, leverage: Vector, dt: float
) -> Whitener:
    """Return a whitener for the noise whose spectrum a fit has left.

    `leverage` (per bin, 0 to 1) is the share of the noise that the fit has taken away. The density
    is a sum of white, 1/f and first-order coloured noises (and of their rates) with weights >= 0,
    by Whittle's likelihood: so it extrapolates soundly below the bins that a fit has eaten, where
    a free curve does not. Narrow lines are clipped, for they are signals.
    """
    kept = np.maximum(1.0 - leverage, 1e-3)
    power = np.abs(spectrum) ** 2 / np.maximum(kept, 0.05)
    frequency = (np.arange(whitener.bins) + 0.5) / (whitener.mask.size * dt)
    shapes = np.array(
        [np.ones_like(frequency)]
        + [frequency**-a for a in _POWERS]
        + [1.0 / (1.0 + (frequency / f) ** 2) for f in _CORNERS_HZ]
        + [frequency**2]
    )
    shapes /= np.mean(shapes, axis=1, keepdims=True)
    edges = np.unique(np.geomspace(1.0, whitener.bins, _GROUPS).astype(int))
    starts = np.concatenate(([0], edges[:-1]))
    weight = np.add.reduceat(kept, starts)
    typical = np.array(
        [
            _typical(p, w)
            for p, w in zip(*(np.split(r, starts[1:]) for r in (power, kept)), strict=True)
        ]
    )
    grouped = np.add.reduceat(shapes, starts, axis=1) / np.diff([*starts, whitener.bins])
    density = _positive_mixture(grouped, typical, weight) @ shapes
    # Below what the fit has left to see, no noise is taken to rise faster than 1/f.
    seen = min(int(np.searchsorted(np.cumsum(kept), _SUPPORT)), whitener.bins - 1)
    steepest = density[seen] * frequency[seen] / frequency
    return Whitener(
        whitener.mask, np.where(frequency < frequency[seen], np.minimum(density, steepest), density)
    )


def _typical(power: Vector, weight: Vector) -> float:
    """Return the mean of exponentially distributed power, lines clipped where bins are many."""
    if power.size < 8:
        return float(np.average(power, weights=weight))
    top = _CLIP * float(np.median(power)) / float(np.log(2.0))
    # The mean of min(E, clip) for a unit exponential E, so that clipping does not bias.
    mean = 1.0 - float(np.exp(-_CLIP))
    return float(np.average(np.minimum(power, top), weights=weight)) / mean


def _positive_mixture(shapes: Matrix, power: Vector, weight: Vector) -> Vector:
    """Return the weights of the mixture of `shapes` most likely to have given the mean powers.

    Multiplicative updates (Itakura and Saito's divergence) keep the weights positive and let
    those that are not needed vanish.
    """
    share = np.full(shapes.shape[0], max(float(np.median(power)), 1e-300) / shapes.shape[0])
    for _ in range(_UPDATES):
        density = share @ shapes
        share *= (shapes @ (weight * power / density**2)) / (shapes @ (weight / density))
        share = np.maximum(share, 1e-12 * share.max())
    return share
