"""How far an estimate runs behind parameters that vary."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.trace import Trace

_MOST_SAMPLES = 20_000
"""Samples compared at most; of a longer run one in so many."""
VARIES_SHARE, VARIES_DEVIATIONS = 0.05, 6.0
"""A parameter varies where its range exceeds this share of its median and so many deviations."""


def reference_stiffness(
    x: Vector, v: Vector, f: Vector, usable: NDArray[np.bool_], half_window: int
) -> tuple[Vector, Vector]:
    """Return stiffness over time, without delay, and its standard deviation.

    A Kelvin-Voigt body (2.1) is fitted by least squares to the samples within +- half_window of
    each, so that past and future have equal weight; x, v, f, usable (samples,), rig units. NaN
    where less than half of the window is usable.
    """
    factors = (x, x), (x, v), (v, v), (x, f), (v, f), (f, f)
    xx, xv, vv, xf, vf, ff = (
        _windowed(np.where(usable, one * other, 0.0), half_window) for one, other in factors
    )
    count = _windowed(usable.astype(np.float64), half_window)
    with np.errstate(invalid="ignore", divide="ignore"):
        determinant = xx * vv - xv * xv
        k = (vv * xf - xv * vf) / determinant
        b = (xx * vf - xv * xf) / determinant
        variance = np.maximum(ff - k * xf - b * vf, 0.0) / count
        deviation = np.sqrt(variance * vv / determinant)
    known = usable & (count >= half_window)
    return np.where(known, k, np.nan), np.where(known, deviation, np.nan)


def varies(reference: Vector, deviation: Vector) -> bool:
    """Return whether a stiffness varies over time by more than 5 % and than its noise."""
    if not np.any(np.isfinite(reference)):
        return False
    low, middle, high = np.nanquantile(reference, [0.05, 0.5, 0.95])
    noise = VARIES_DEVIATIONS * float(np.nanmedian(deviation))
    return bool(high - low > max(VARIES_SHARE * abs(middle), noise))


def _windowed(row: Vector, half: int) -> Vector:
    """Return the sum of the samples within +- half of each."""
    total = np.concatenate(([0.0], np.cumsum(row)))
    middle = np.arange(row.size)
    return total[np.minimum(middle + half + 1, row.size)] - total[np.maximum(middle - half, 0)]


def tracking_delay(t: Vector, estimate: Vector, truth: Vector) -> float | None:
    """Return the delay [s] at which the estimate fits the delayed truth best.

    t (samples,) equidistant [s], estimate and truth (samples,) in any one unit. None where truth
    does not vary, or the estimate does not follow it at all (correlation below a half). Delays up
    to half the record are searched.
    """
    step = float(t[1] - t[0])
    if np.ptp(truth) == 0.0 or np.ptp(estimate) == 0.0:
        return None
    longest = len(t) // 2
    stride = max(1, longest // 500)
    errors = [_error(estimate, truth, shift) for shift in range(0, longest, stride)]
    coarse = int(np.argmin(errors)) * stride
    fine = range(max(0, coarse - stride), min(longest, coarse + stride + 1))
    best = min(fine, key=lambda shift: _error(estimate, truth, shift))
    delayed = np.concatenate([np.full(best, truth[0]), truth[: len(truth) - best]])
    if np.ptp(delayed) == 0.0 or np.corrcoef(estimate, delayed)[0, 1] < 0.5:
        return None
    return best * step


def stiffness_delays(trace: Trace, half_window_s: float = 0.25) -> list[float | None]:
    """Return by row how far its stiffness runs behind that of the body [s].

    None for a row without a linear stiffness, for one that does not follow, and for all where
    the body's stiffness does not vary.
    """
    x, v, f = (trace.signals[:, column] for column in (3, 4, 7))
    usable = (trace.signals[:, 0] > 0.0) & np.isfinite(f)
    half = max(1, round(half_window_s / trace.period_s))
    reference, deviation = reference_stiffness(x, v, f, usable, half)
    if not varies(reference, deviation):
        return [None] * len(trace.rows)
    stride = max(1, reference.size // _MOST_SAMPLES)
    body = _held(reference)[::stride]
    t = np.arange(float(body.size)) * (stride * trace.period_s)
    delays: list[float | None] = []
    for index, row in enumerate(trace.rows):
        linear = row.linear and "k" in trace.names(index)
        estimate = _held(trace.physical(index, "k"))[::stride] if linear else None
        delays.append(None if estimate is None else tracking_delay(t, estimate, body))
    return delays


def _held(values: Vector) -> Vector:
    """Return values with each NaN replaced by the value before it, or by the first known."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == 0:
        return np.zeros_like(values)
    last = np.searchsorted(known, np.arange(values.size), side="right") - 1
    return values[known[np.maximum(last, 0)]]


def _error(estimate: Vector, truth: Vector, shift: int) -> float:
    """Return the mean square difference between an estimate and truth delayed by `shift`."""
    head = float(np.sum((estimate[:shift] - truth[0]) ** 2))
    tail = float(np.sum((estimate[shift:] - truth[: len(truth) - shift]) ** 2))
    return (head + tail) / len(truth)
