"""Noise: its spectrum from a residual, and the filter that makes it white (after Whittle)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.diagnosis.noise import slow
from teleop_rt.diagnosis.noise.colours import Spectrum, density_of

Places = NDArray[np.intp]
BAND_HZ = 250.0  # Hz; motions of hand and rig, and swings that they excite, lie below
_LINE_POWER_RATIO = 5.0  # times the typical power of a bin; a larger power is a line, no noise
# Longest hole that a line bridges, in samples and in s: slower signals pass unchanged.
_BRIDGED_SAMPLES, _BRIDGED_S = 4, 4e-3
_GROUPS = 120  # of bins, ever wider, by which a spectrum is compared
_SUPPORTING_BINS = 8.0  # bins that determine the noise level; below them it is extrapolated
_LOWEST_OCTAVE_BINS = 8  # bins of the lowest octave in which noise is bounded
_LARGEST_DENSITY_RATIO = 4.0  # times the residual power of an octave that noise may have
_LEAST_UNKNOWN = 1e-6  # of a density; encoder errors may be all of the noise
_FLOOR_QUANTILE = 0.2  # of the densities: the white noise of a sensor lies at most bins
_LOWEST_BIN = 0.25
"""The mean of a recording is attributed to two octaves below one period of it."""


@dataclass(frozen=True)
class Whitener:
    """Takes rows of samples to the frequency domain, where the noise has variance 1.

    `mask` (0 to 1) leaves out samples; `bridged` in a row, and fewer, are bridged by a line.
    `density` is the noise power that each kept bin would have with none left out: so noise has
    variance 1 along whatever the remaining samples determine, and chi-square counts those. Real
    and imaginary parts stand side by side, so scalar products are those of real vectors. Spectra
    need no model order, and reach 1/f noise down to the lowest bin. They take a recording to begin
    where it ends, which red noise does not: see `slow`. `known` is the part of the density that the
    encoder's errors make. `level` is the deviation of the noise at each sample, over its root mean
    square (see `level`): spectra take it to be even, draws follow it.
    """

    mask: Vector
    density: Vector
    known: Vector
    bridged: int
    level: Vector

    @property
    def bins(self) -> int:
        """Number of frequency bins kept."""
        return int(self.density.size)

    @cached_property
    def effective(self) -> float:
        """Number of independent values in the band that the mask leaves."""
        return 2.0 * self.bins * self.kept

    @property
    def samples(self) -> float:
        """Number of samples in use, whatever their frequencies."""
        return float(self.mask.size * self.kept)

    @cached_property
    def kept(self) -> float:
        """Share of the samples that the mask leaves."""
        return float(np.mean(self.mask**2))

    def spectra(self, rows: Matrix) -> NDArray[np.complex128]:
        """Return the kept bins of masked rows."""
        places, before, after, share = self._short_holes
        left = rows * self.mask
        if places.size:
            left[..., places] = (1.0 - share) * rows[..., before] + share * rows[..., after]
        return np.fft.rfft(left)[..., : self.bins]

    @cached_property
    def _short_holes(self) -> tuple[Places, Places, Places, Vector]:
        """Where a few samples are left out: those, the last before, the next, and how far between.

        A line over them holds nothing of their values, as zeros do, but zeros would let the slow
        part of red noise through to high frequencies, where such noise is taken to be quiet.
        """
        short = [(a, b) for a, b in slow.inner_holes(self.mask) if b - a <= self.bridged]
        bridged = [(i, a - 1, b) for a, b in short for i in range(a, b)]
        places, before, after = np.array(bridged, dtype=np.intp).reshape(-1, 3).T
        return places, before, after, (places - before) / (after - before)

    def __call__(self, rows: Matrix) -> Matrix:
        """Return whitened rows, twice as many values as bins."""
        found = self._as_if_periodic(rows)
        if self._slow is not None:
            directions, share = self._slow
            found -= (found @ directions * share) @ directions.T
        return found

    def _as_if_periodic(self, rows: Matrix) -> Matrix:
        spectra, bins = self.spectra(rows), self.bins
        found = np.empty((*spectra.shape[:-1], 2 * bins))
        np.multiply(spectra.real, self._scale, out=found[..., :bins])
        np.multiply(spectra.imag, self._scale, out=found[..., bins:])
        return found

    @cached_property
    def _slow(self) -> tuple[Matrix, Vector] | None:
        """Directions in which noise exceeds its spectrum, and the share to subtract."""
        return slow.excess(
            self._as_if_periodic(slow.rows(self.mask)), self._scale, self.density, self.mask
        )

    @cached_property
    def _scale(self) -> Vector:
        scale = np.sqrt(2.0 / self.density)
        scale[0] /= np.sqrt(2.0)
        return np.asarray(scale, dtype=np.float64)

    def coloured(self, rows: Matrix) -> tuple[Matrix, float]:
        """Return rows of samples without their white part, by Wiener's filter, and its power share.

        The share is that of the rest in the power of the noise.
        """
        floor = float(np.quantile(self.density, _FLOOR_QUANTILE))
        gain = np.zeros(self.mask.size // 2 + 1)
        gain[1 : self.bins] = 1.0 - floor / np.maximum(self.density[1:], floor)
        share = float(gain[: self.bins] @ self.density) / float(np.sum(self.density))
        return np.fft.irfft(np.fft.rfft(rows * self.mask) * gain, self.mask.size), share

    def evenly(self, deviation: float) -> Whitener:
        """Return a whitener of the same samples and band for white noise of this deviation."""
        density = np.full(self.bins, deviation**2 * self.mask.size)
        return replace(self, density=density, known=np.zeros(self.bins))

    def draws(self, number: int, seed: int = 5) -> Matrix:
        """Return whitened draws of this noise."""
        return self(self._samples(self.density, number, seed))

    def unknown_noise(self, number: int, seed: int = 5) -> Matrix:
        """Return draws (number, samples) of this noise without the part that is `known`."""
        unknown = np.maximum(self.density - self.known, _LEAST_UNKNOWN * self.density)
        return self._samples(unknown, number, seed)

    def _samples(self, density: Vector, number: int, seed: int) -> Matrix:
        rng = np.random.default_rng(seed)
        size = self.mask.size
        longer = 1 if self._slow is None else 2
        colour = np.sqrt(slow.finer(density, size, longer) / size)
        noise = rng.standard_normal((number, longer * size))
        return self.level * np.fft.irfft(np.fft.rfft(noise) * colour, longer * size)[:, :size]


def band_bins(samples: int, dt: float, edge_hz: float = BAND_HZ) -> int:
    """Return how many bins lie below the band's edge: `edge_hz`, or 0.4 of the rate."""
    edge = min(edge_hz, 0.4 / dt)
    return int(edge * dt * samples)


def white(mask: Vector, deviation: float, dt: float, edge_hz: float = BAND_HZ) -> Whitener:
    """Return a whitener for white noise of a known standard deviation."""
    bins = band_bins(mask.size, dt, edge_hz)
    bridged = max(_BRIDGED_SAMPLES, round(_BRIDGED_S / dt))
    return Whitener(
        mask, np.full(bins, deviation**2 * mask.size), np.zeros(bins), bridged, np.ones(mask.size)
    )


def knowing(whitener: Whitener, errors: Matrix) -> Whitener:
    """Return the whitener that knows a part of the noise, from whitened samples of it (rows)."""
    bins = whitener.bins
    power = np.mean(power_of(errors), axis=0) * whitener.density
    starts, sizes = _groups(bins)
    smooth = np.add.reduceat(power, starts) / sizes
    return replace(whitener, known=np.repeat(smooth, sizes) / (2.0 * whitener.kept))


def power_of(whitened: Matrix) -> Matrix:
    """Return the power of whitened rows in each bin."""
    bins = whitened.shape[-1] // 2
    return np.asarray(whitened[..., :bins] ** 2 + whitened[..., bins:] ** 2)


class Left(NamedTuple):
    """A whitened residual, and the share of each of its values that a fit has absorbed."""

    row: Vector
    taken: Vector

    def power(self, whitener: Whitener) -> Vector:
        """Return the power of each bin in the unit of the density, without the absorbed share."""
        power = 0.5 * whitener.density * power_of(self.row)
        power[0] *= 2.0
        return np.asarray(power)

    def kept(self, whitener: Whitener) -> Vector:
        """Return the share of each bin that is left after mask and fit."""
        bins = whitener.bins
        leverage = np.minimum(0.5 * (self.taken[:bins] + self.taken[bins:]), 1.0)
        return np.maximum(whitener.kept - leverage, 1e-3)


def estimate(noise: Left, whole: Left, whitener: Whitener, dt: float) -> Whitener:
    """Return a whitener for the noise in the residual of a fit.

    `noise` is the residual without structure, `whole` with it. The density is a sum of few shapes
    (`colours`) on top of the part that is known: so it extrapolates to the low bins that the fit
    has absorbed, where a free curve has no data. Narrow lines are clipped as signals. The density
    is bounded by a multiple of the whole residual.
    """
    kept = noise.kept(whitener)
    power = noise.power(whitener) / np.maximum(kept, 0.05)
    frequency = np.maximum(np.arange(whitener.bins), _LOWEST_BIN) / (whitener.mask.size * dt)
    starts, sizes = _groups(whitener.bins)
    weight = np.add.reduceat(kept, starts)
    typical = np.array(
        [
            _typical(p, w)
            for p, w in zip(*(np.split(r, starts[1:]) for r in (power, kept)), strict=True)
        ]
    )

    def grouped(rows: Matrix) -> Matrix:
        return np.asarray(np.add.reduceat(rows, starts, axis=-1) / sizes)

    sensor = density_of(frequency, Spectrum(typical, weight, grouped(whitener.known)), grouped)
    density = sensor + whitener.known
    # Below the bins that the fit has left, noise is assumed to rise no faster than 1/f.
    seen = min(int(np.searchsorted(np.cumsum(kept), _SUPPORTING_BINS)), whitener.bins - 1)
    steepest = density[seen] * frequency[seen] / frequency
    bounded = np.where(frequency < frequency[seen], np.minimum(density, steepest), density)
    most = np.maximum(_largest_density(whole, whitener), whitener.known + np.min(sensor))
    return replace(whitener, density=np.minimum(bounded, most))


def _largest_density(whole: Left, whitener: Whitener) -> Vector:
    """Return the largest noise density of each bin, from the residual power of its octave.

    The mean power of eight bins is below a quarter of its true value once in two thousand times.
    """
    edges = [0, *(_LOWEST_OCTAVE_BINS * 2 ** np.arange(32)).tolist()]
    starts = np.array([edge for edge in edges if edge < whitener.bins])
    kept = whole.kept(whitener)
    typical = np.add.reduceat(whole.power(whitener), starts) / np.add.reduceat(kept, starts)
    return np.repeat(_LARGEST_DENSITY_RATIO * typical, np.diff(np.append(starts, whitener.bins)))


def _groups(bins: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where groups of bins begin, ever wider, and their sizes."""
    edges = np.unique(np.geomspace(1.0, bins, _GROUPS).astype(np.int64))
    starts = np.concatenate(([0], edges[:-1]))
    return starts, np.diff(np.append(starts, bins))


def _typical(power: Vector, weight: Vector) -> float:
    """Return the mean of exponentially distributed power, lines clipped where bins are many."""
    share = weight / np.sum(weight)
    if power.size < 8:
        return float(power @ share)
    top = _LINE_POWER_RATIO * float(np.median(power)) / float(np.log(2.0))
    # The mean of min(E, clip) for a unit exponential E, so that clipping does not bias.
    mean = 1.0 - float(np.exp(-_LINE_POWER_RATIO))
    return float(np.minimum(power, top) @ share) / mean
