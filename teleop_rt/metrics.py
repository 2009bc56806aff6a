"""How far apart two forces are: normalised error, also in percent, and lag below a sample."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Signal = NDArray[np.float64]
Mask = NDArray[np.bool_]

_LEAD = 0.05
"""By how much a correlation peak must stand above any other to be the one."""


def nrmse(measured: Signal, predicted: Signal) -> float | None:
    """Return the root-mean-square error over the range of `measured`, (4.1) of the report.

    Both of shape (n,); samples where either is not finite are left out. None where fewer than
    two samples are left or the measured force is constant.
    """
    whole = np.isfinite(measured) & np.isfinite(predicted)
    if np.count_nonzero(whole) < 2:
        return None
    reference = measured[whole]
    span = float(np.ptp(reference))
    if span <= 0.0:
        return None
    return float(np.sqrt(np.mean((reference - predicted[whole]) ** 2)) / span)


def error_of_size(true: Signal, felt: Signal) -> float | None:
    """Return the root-mean-square error over the size of `true`: its range, or its largest value.

    The larger of the two: a hand that holds feels a force that hardly moves, of which it notices a
    share (Weber's law), as it does of a force that swings from none. Both of shape (n,); samples
    where either is not finite are left out. None where fewer than two are left, or `true` is zero.
    """
    whole = np.isfinite(true) & np.isfinite(felt)
    if np.count_nonzero(whole) < 2:
        return None
    reference = true[whole]
    size = max(float(np.ptp(reference)), float(np.max(np.abs(reference))))
    if size <= 0.0:
        return None
    return float(np.sqrt(np.mean((reference - felt[whole]) ** 2)) / size)


def in_percent(share: float, digits: int = 2) -> str:
    """Return a share in percent, as a plain number of so many digits: 120 %, not 1.2e+02 %."""
    return f"{float(f'{100.0 * share:.{digits}g}'):g} %"


def lag_s(reference: Signal, delayed: Signal, period_s: float, max_lag_s: float) -> float | None:
    """Return by how much `delayed` lags `reference`: the peak of their cross-correlation.

    The correlation coefficient is computed for each lag in +-max_lag_s over the samples that
    overlap and are finite in both, so neither the ends nor gaps pull the peak; a parabola
    through the peak and its neighbours gives the fraction of a sample. None where there is too
    little overlap, no variation to correlate, no peak within the search but its edge, or a second
    peak nearly as high: a motion that repeats itself determines its lag only up to whole periods.
    """
    most = min(round(max_lag_s / period_s), reference.size - 2)
    if most < 1:
        return None
    correlation = _correlation_by_lag(reference, delayed, most)
    if not np.any(np.isfinite(correlation)):
        return None
    peak = int(np.nanargmax(correlation))
    at_edge = not 0 < peak < 2 * most or not np.isfinite(correlation[peak - 1 : peak + 2]).all()
    if at_edge or _rivalled(correlation, peak):
        return None
    before, at, after = correlation[peak - 1 : peak + 2]
    curvature = before - 2 * at + after
    fraction = float(0.5 * (before - after) / curvature) if curvature < 0 else 0.0
    return (peak - most + fraction) * period_s


def _rivalled(correlation: Signal, peak: int) -> bool:
    """Return whether another local maximum comes within _LEAD of the one at `peak`."""
    inner = correlation[1:-1]
    with np.errstate(invalid="ignore"):
        maxima = 1 + np.flatnonzero((inner > correlation[:-2]) & (inner >= correlation[2:]))
    rivals = maxima[(maxima != peak) & (correlation[maxima] > correlation[peak] - _LEAD)]
    between = (correlation[min(rival, peak) : max(rival, peak) + 1] for rival in rivals)
    return any(float(np.nanmin(valley)) < correlation[peak] - 2 * _LEAD for valley in between)


def _correlation_by_lag(reference: Signal, delayed: Signal, most: int) -> Signal:
    """Return the correlation coefficients for lags -most..most, shape (2 most + 1,)."""
    size = 1 << (2 * reference.size - 1).bit_length()
    ref_mask, del_mask = np.isfinite(reference), np.isfinite(delayed)
    ref = np.where(ref_mask, reference - np.mean(reference, where=ref_mask), 0.0)
    dly = np.where(del_mask, delayed - np.mean(delayed, where=del_mask), 0.0)

    def spectrum(values: Signal | Mask) -> NDArray[np.complex128]:
        return np.fft.rfft(values.astype(np.float64), size)

    def product(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> Signal:
        full = np.fft.irfft(np.conj(a) * b, size)
        return np.concatenate((full[-most:], full[: most + 1]))

    one_r, one_d = spectrum(ref_mask), spectrum(del_mask)
    count = np.round(product(one_r, one_d))
    sum_r = product(spectrum(ref), one_d)
    sum_d = product(one_r, spectrum(dly))
    sum_rr = product(spectrum(ref**2), one_d)
    sum_dd = product(one_r, spectrum(dly**2))
    sum_rd = product(spectrum(ref), spectrum(dly))
    enough = count >= max(3, 0.25 * float(count.max()))
    with np.errstate(invalid="ignore", divide="ignore"):
        variance_r = sum_rr - sum_r**2 / count
        variance_d = sum_dd - sum_d**2 / count
        covariance = sum_rd - sum_r * sum_d / count
        floor_r = 1e-9 * float(np.sum(ref**2))
        floor_d = 1e-9 * float(np.sum(dly**2))
        varies = (variance_r > floor_r) & (variance_d > floor_d)
        result = covariance / np.sqrt(variance_r * variance_d)
    return np.where(enough & varies, result, np.nan)
