"""Colours of noise: a density as a sum of few shapes, by Whittle's likelihood."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from teleop_rt.contact.effect import Matrix, Vector
from teleop_rt.kernels.jit import kernel

_UPDATES = 400  # rounds in which the weights of the colours settle
_VANISHING_WEIGHT = 1e-3  # of all weights; a colour with less does not count
_POWERS = (0.5, 1.0, 1.5, 2.0)  # of 1/f; from flicker to a random walk
# No lower corner: the fit absorbs the lowest bins, so no data support a flat density there.
_CORNERS_HZ = (15.0, 50.0)
_LOWEST_RESONANCE_HZ = 5.0  # Hz; motions of hand and rig, and swings that they excite, lie below
_DAMPING = (0.02, 0.05, 0.15)  # of critical, of a mounted sensor; half a decade apart
_LEAST_PEAK_RATIO = 5.0  # times the other noise; a smaller hump may be the error of a law


class Spectrum(NamedTuple):
    """Groups of bins: their typical `power`, the `weight` of each, and the `known` density."""

    power: Vector
    weight: Vector
    known: Vector


class _Mixture(NamedTuple):
    """Weights of shapes, and the criterion by which they are compared: smaller is likelier."""

    share: Vector
    criterion: float


def density_of(
    frequency: Vector, spectrum: Spectrum, grouped: Callable[[Matrix], Matrix]
) -> Vector:
    """Return the likeliest density of the noise at each `frequency` [Hz], without the known part.

    `grouped` averages rows over the groups of the `spectrum`. Of white noise, colours and one
    resonance those count that earn their parameters by Schwarz's criterion.
    """
    shapes = _scaled(
        np.array(
            [np.ones_like(frequency)]
            + [frequency**-a for a in _POWERS]
            + [1.0 / (1.0 + (frequency / f) ** 2) for f in _CORNERS_HZ]
            + [frequency**2]
        )
    )
    plain = _likeliest(grouped(shapes), spectrum)
    peak = _peak(grouped(frequency), plain.share @ grouped(shapes) + spectrum.known, spectrum)
    if peak is None:
        return np.asarray(plain.share @ shapes)
    tried = [np.vstack([shapes, _resonance(frequency, peak, damping)]) for damping in _DAMPING]
    found = [_likeliest(grouped(rows), spectrum, resonant=True) for rows in tried]
    best, rows = min(zip(found, tried, strict=True), key=lambda one: one[0].criterion)
    if best.criterion >= plain.criterion:
        return np.asarray(plain.share @ shapes)
    return np.asarray(best.share @ rows)


def _scaled(shapes: Matrix) -> Matrix:
    return np.asarray(shapes / np.mean(shapes, axis=-1, keepdims=True))


def _resonance(frequency: Vector, peak: float, damping: float) -> Vector:
    """Return the density of white noise through a resonance at `peak` [Hz]."""
    ratio = (frequency / peak) ** 2
    return _scaled(1.0 / ((1.0 - ratio) ** 2 + 4.0 * damping**2 * ratio))


def _peak(frequency: Vector, density: Vector, spectrum: Spectrum) -> float | None:
    """Return the frequency [Hz] at which the power exceeds the density most; None if too little."""
    ratio = spectrum.power / density
    beyond = np.where(frequency > _LOWEST_RESONANCE_HZ, spectrum.weight * (ratio - 1.0), 0.0)
    place = int(np.argmax(beyond))
    return float(frequency[place]) if ratio[place] > _LEAST_PEAK_RATIO else None


def _likeliest(shapes: Matrix, spectrum: Spectrum, *, resonant: bool = False) -> _Mixture:
    """Return the weights of all `shapes`, or of the first (white) alone if others earn too little.

    Chance may give white noise a colour, which would weight the lowest bins, those of the motion,
    wrongly. A resonance, the last of the shapes, has a frequency and a damping as well.
    """
    power, weight, known = spectrum
    candidates = []
    for last in (len(shapes),) if resonant else (1, len(shapes)):
        share = np.zeros(len(shapes))
        share[:last] = positive_mixture(shapes[:last], spectrum)
        density = share @ shapes + known
        misfit = 2.0 * float(np.sum(weight * (np.log(density) + power / density)))
        colours = np.count_nonzero(share[1:] > _VANISHING_WEIGHT * share.sum()) + 2 * resonant
        criterion = misfit + max(colours, last > 1) * np.log(weight.sum())
        candidates.append(_Mixture(share, criterion))
    return min(candidates, key=lambda one: one.criterion)


def positive_mixture(shapes: Matrix, spectrum: Spectrum) -> Vector:
    """Return the weights of `shapes` whose sum, and the known power, most likely gave the power.

    Multiplicative updates (Itakura and Saito's divergence) keep the weights positive and let
    those that are not needed vanish.
    """
    power = spectrum.power
    share = np.full(shapes.shape[0], max(float(np.median(power)), 1e-300) / shapes.shape[0])
    _update(share, np.ascontiguousarray(shapes), *spectrum, np.empty_like(share), share.copy())
    return share


@kernel
def _update(
    share: Vector,
    shapes: Matrix,
    power: Vector,
    weight: Vector,
    known: Vector,
    wanted: Vector,
    had: Vector,
) -> None:
    for _ in range(_UPDATES):
        wanted[:] = had[:] = 0.0
        for i in range(power.size):
            density = known[i]
            for j in range(share.size):
                density += share[j] * shapes[j, i]
            part = weight[i] / density
            for j in range(share.size):
                had[j] += shapes[j, i] * part
                wanted[j] += shapes[j, i] * part * power[i] / density
        most = 0.0
        for j in range(share.size):
            share[j] *= wanted[j] / had[j]
            most = max(most, share[j])
        for j in range(share.size):
            share[j] = max(share[j], 1e-12 * most)
