"""A force sensor's scale and offset by weights that are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_rt.errors import ExpectedError

Vector = NDArray[np.float64]

LEAST_SAMPLES = 20
"""Samples of a reading: fewer determine neither its noise nor its drift."""
LARGEST_FACTOR = 100.0
"""A scale that is wrong by more is no scale to correct: the field or the unit is another."""
LARGEST_ERROR = 0.05
"""Share of the span by which a reading may miss the line; a load cell keeps 0.001."""
LARGEST_NOISE = 0.1
"""Share of the span that a deviation of the noise may have."""
LARGEST_DRIFT = 0.02
"""Share of the span by which a reading may drift while it is taken: something still swings."""


class CalibrationError(ExpectedError):
    """The experiment does not allow a calibration: the message gives cause and next step."""


@dataclass(frozen=True, slots=True)
class Weighing:
    """The sensor's reading under a known force: n samples over seconds, both in the rig's unit."""

    force: float
    samples: Vector
    seconds: float

    @property
    def mean(self) -> float:
        """Return the mean of the samples."""
        return float(np.mean(self.samples))

    def line(self) -> tuple[float, float]:
        """Return the noise about a straight line through the samples, and the line's whole rise."""
        time = np.linspace(-0.5, 0.5, self.samples.size)
        centred = self.samples - self.mean
        rise = float(time @ centred / (time @ time))
        noise = float(np.sqrt(np.sum((centred - rise * time) ** 2) / (self.samples.size - 2)))
        return noise, rise


@dataclass(frozen=True, slots=True)
class ForceFit:
    """True force = offset + factor * the sensor's reading with its present scale and offset.

    noise, drift per second and the largest error of a reading are in true units [rig unit].
    """

    factor: float
    offset: float
    noise: float
    drift_per_s: float
    largest_error: float
    span: float

    @property
    def linearity(self) -> float:
        """Return the largest error of a reading as a share of the span."""
        return self.largest_error / self.span


UNSEEN_SHARE = 0.5
"""Of a reading's noise: a smaller change by all weights together may be noise."""


def fit_weights(readings: list[Weighing], *, raw: bool = False) -> ForceFit:
    """Return the line through readings of two or more forces. Raises CalibrationError.

    Of `raw` readings, in the sensor's own numbers, no scale is too far off.
    """
    forces = np.array([reading.force for reading in readings])
    if len(set(forces.tolist())) < 2:
        raise CalibrationError("weights: two different ones are needed; one may be 0")
    if any(reading.samples.size < LEAST_SAMPLES for reading in readings):
        raise CalibrationError(
            f"weights: a reading has fewer than {LEAST_SAMPLES} samples: read for longer"
        )
    means = np.array([reading.mean for reading in readings])
    noise = max(float(np.std(reading.samples)) for reading in readings)
    if np.ptp(means) <= UNSEEN_SHARE * noise:
        raise CalibrationError(
            "the force does not change with the weight: check that it hangs on the sensor, and "
            "whether the rig names the right field"
        )
    factor, offset = np.polyfit(means, forces, 1)
    if factor <= 0.0:
        raise CalibrationError(
            "the force falls as the weight grows: invert `sign` of the force, or give the "
            "weights as pulling (--pull)"
        )
    if not raw and not 1.0 / LARGEST_FACTOR <= factor <= LARGEST_FACTOR:
        raise CalibrationError(
            f"the scale would change by {factor:.3g}: check the field, its unit and the weights,"
            " or begin from the sensor's own numbers, with a scale of 1 and an offset of 0"
        )
    return _judged(readings, float(factor), float(offset), float(np.ptp(forces)))


def _judged(readings: list[Weighing], factor: float, offset: float, span: float) -> ForceFit:
    """Return the fit, unless the readings are no line, noisy or moving. Raises CalibrationError."""
    lines = [reading.line() for reading in readings]
    fit = ForceFit(
        factor=factor,
        offset=offset,
        noise=factor * float(np.sqrt(np.mean([noise**2 for noise, _ in lines]))),
        drift_per_s=factor
        * max(abs(rise) / one.seconds for one, (_, rise) in zip(readings, lines, strict=True)),
        largest_error=max(abs(offset + factor * one.mean - one.force) for one in readings),
        span=span,
    )
    for what, value, most, step in (
        ("a reading misses the line by", fit.largest_error, LARGEST_ERROR, "check the weights"),
        ("the noise is", fit.noise, LARGEST_NOISE, "check shielding, or take heavier weights"),
        ("a reading drifts by", factor * max(abs(rise) for _, rise in lines), LARGEST_DRIFT,
         "let the weight hang still, and the sensor warm up"),
    ):  # fmt: skip
        if value > most * span:
            raise CalibrationError(
                f"{what} {value:.3g}, more than {100 * most:g} % of the span {span:.3g}: {step}"
            )
    return fit
