"""The force's lag behind position, from a recording of a body whose damping is known.

A force that is late by t reads k x - (k t) x': so the damping that the estimators find beside the
body's own is -k t. A steel spring has next to none.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import rows_for
from teleop_rt.offline.load import load_online
from teleop_rt_drivers.calibration.weights import CalibrationError

LARGEST_DEVIATION_MS = 1.0
"""A lag that is known no better is none that was found."""
LONGEST_MS = 50.0
"""Of a lag that a rig may have (`sensors.force_lag_ms`)."""
LEAD_DEVIATIONS, LEAST_LEAD_MS = 3.0, 0.1
"""A lead of the force by more than both together is none of chance, nor of a spring's damping."""


@dataclass(frozen=True, slots=True)
class LagFit:
    """The lag and its standard deviation [ms], and the body's stiffness [rig unit]."""

    lag_ms: float
    deviation_ms: float
    stiffness: float


def find_lag(recording: Path, damping: float | None = None) -> LagFit:
    """Return the lag by a recording of ours; `damping` is the body's own [rig unit], None unknown.

    A body of unknown damping is taken for a spring, which has none, and a force that leads the
    position is then refused: the body's damping looks the same.

    Raises CalibrationError if the recording does not determine it, RecordingError for no recording.
    """
    found, spread, taken_out_s = _spring(recording)
    k, excess = found["k"], found["b"] - (damping or 0.0)
    fit = LagFit(
        lag_ms=1e3 * (taken_out_s - excess / k),
        deviation_ms=1e3 * math.hypot(spread["b"], excess / k * spread["k"]) / k,
        stiffness=k,
    )
    _refuse(fit, recording, spring=damping is None)
    return fit


def _spring(recording: Path) -> tuple[dict[str, float], dict[str, float], float]:
    """Return k and b of the body, their deviations, and the lag [s] that was taken out before.

    Raises CalibrationError where no stiffness is found.
    """
    online = load_online(recording)
    settings = replace(online.settings, force_lag_deviation_s=0.0)
    taken_out_s = settings.force_lag_s if settings.paired_lag_s is None else settings.paired_lag_s
    pipeline = Pipeline(rows_for(["kelvin-voigt"], ["direct"], ["rls"]), settings)
    pipeline.run(online.position, online.force, online.valid)
    names, values, deviations = pipeline.estimate(0)
    found = dict(zip(names, values.tolist(), strict=True))
    if deviations is None or not found.get("k", math.nan) > 0.0:
        raise CalibrationError(
            f"{recording}: no stiffness was found: press on a spring several times, 10 s or more, "
            "with contact.onset_force above the force in free air"
        )
    return found, dict(zip(names, deviations.tolist(), strict=True)), taken_out_s


def _refuse(fit: LagFit, recording: Path, *, spring: bool) -> None:
    """Raise CalibrationError for a lag that is uncertain, implausible, or a lead on a spring."""
    lag_ms, deviation_ms = fit.lag_ms, fit.deviation_ms
    if not deviation_ms <= LARGEST_DEVIATION_MS:
        raise CalibrationError(
            f"{recording}: the lag can only be determined to {deviation_ms:.2g} ms: press faster, "
            "deeper and for longer, on something stiffer"
        )
    if not abs(lag_ms) <= LONGEST_MS:
        raise CalibrationError(
            f"{recording}: a lag of {lag_ms:.3g} ms is implausible for a sensor: "
            "press on a body without damping"
        )
    if spring and lag_ms < -LEAD_DEVIATIONS * deviation_ms - LEAST_LEAD_MS:
        raise CalibrationError(
            f"{recording}: the force would lead the position by {-lag_ms:.3g} ms, as it does on a "
            "body that damps: press on a steel spring, or give the body's own damping (--damping 0 "
            "if it has none and the position is late)"
        )
