"""The residual of the selected model: its size, and whether it contains structure."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

Array = NDArray[np.float64]

LAGS = 20
"""Lags of the autocorrelation in the test for whiteness."""
ADEQUATE, INADEQUATE = "model adequate", "model inadequate"
_MISSING = "; an effect is missing: run teleop-rt diagnose"
_LEAST_SAMPLES = 4 * LAGS  # samples, below which the test is not made
_WHITE_P_VALUE = 1e-3  # p-value: of 1000 white residuals one is called correlated
NOTABLE = 2.0  # times the noise; up to this a residual without a test on-line counts as explained


@dataclass(frozen=True, slots=True)
class Whiteness:
    """A residual in contact, thinned to its filter's own correlation time.

    `correlation` (LAGS,) is its autocorrelation from the first lag on; `bound` holds 95 % of
    white noise; `p_value` is Ljung and Box's (1978); `rms` is in the unit of force.
    """

    rms: float
    spacing_s: float
    correlation: Array
    bound: float
    p_value: float

    @property
    def white(self) -> bool:
        """True where the correlation is no more than chance."""
        return self.p_value >= _WHITE_P_VALUE


def whiteness(residual: Array, period_s: float, cutoff_hz: float) -> Whiteness | None:
    """Return the whiteness of a residual (n,), not-a-number where there is none; None if too short.

    The estimators see force and motion through a low-pass filter, which colours even white noise:
    so samples closer together than 1 / cutoff say nothing new, and are left out.
    """
    step = max(1, math.ceil(1.0 / (cutoff_hz * period_s)))
    known = residual[np.isfinite(residual)]
    thin = known[::step]
    if thin.size < _LEAST_SAMPLES:
        return None
    rms = float(np.sqrt(np.mean(known**2)))
    centred = thin - np.mean(thin)
    power = float(centred @ centred)
    if not power > 0.0:
        return None
    lags = np.arange(1, LAGS + 1)
    correlation = np.array([float(centred[:-lag] @ centred[lag:]) / power for lag in lags])
    size = thin.size
    statistic = size * (size + 2) * float(np.sum(correlation**2 / (size - lags)))
    return Whiteness(
        rms=rms,
        spacing_s=step * period_s,
        correlation=correlation,
        bound=1.96 / math.sqrt(size),
        p_value=float(scipy.special.gammaincc(LAGS / 2.0, statistic / 2.0)),
    )


def verdict(
    found: Whiteness | None, noise: float, unit: str, inadequate: bool | None = None
) -> dict[str, Any]:
    """Return `{grade, title, text}`, the conclusion for a reader; `noise` is the sensor's [unit].

    `inadequate` is the daemon's own verdict on its model, if there is one. It is based on more
    data, so it decides, and the figures only accompany it.

    A residual below twice the sensor's noise is called explained even where it is coloured, for
    then no model would serve the hand better; above it, colour means that an effect is missing.
    """
    if found is None and inadequate is not None:
        unknown = "too little contact after the model had settled to show its size"
        return {
            "grade": "attention" if inadequate else "good",
            "title": INADEQUATE if inadequate else ADEQUATE,
            "text": unknown + (_MISSING if inadequate else ""),
        }
    if found is None:
        return {
            "grade": "unknown",
            "title": "not judged",
            "text": "too little contact after the model had settled",
        }
    ratio = found.rms / noise
    size = f"{found.rms:.3g} {unit} rms, {ratio:.2g} × the sensor's noise"
    colour = "white" if found.white else f"correlated (lag 1: {found.correlation[0]:+.2f})"
    text = f"{size}, {colour}"
    if inadequate is not None:
        text += _MISSING if inadequate else ""
        return {
            "grade": "attention" if inadequate else "good",
            "title": INADEQUATE if inadequate else ADEQUATE,
            "text": text,
        }
    if ratio <= NOTABLE:
        return {"grade": "good", "title": ADEQUATE, "text": text}
    if found.white:
        text += "; the noise is larger than the rig says: check sensors.force_noise"
        return {"grade": "attention", "title": "noisy", "text": text}
    return {"grade": "attention", "title": INADEQUATE, "text": text + _MISSING}
