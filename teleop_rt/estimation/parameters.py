"""From scaled regression parameters to those of the model, with their standard deviations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.models import Parameter
from teleop_rt.estimation.rows import RowSpec

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]


def scale_of(name: str, length: float, time: float) -> float:
    """Return the factor from a scaled parameter to the rig's unit, for the linear models."""
    return {"k": 1.0 / length, "b": time / length, "m": time * time / length}.get(name, 1.0)


def _scales(row: RowSpec, names: list[str], length: float, time: float) -> Vector:
    """Return the factor of each named parameter of a row: of its model, or of an effect."""
    effects = [row.scale_of_effect(name) for name in names]
    return np.array(
        [
            scale_of(name, length, time) if scale is None else scale
            for name, scale in zip(names, effects, strict=True)
        ]
    )


def _hunt_crossley(theta: Vector, length: float, time: float) -> tuple[Vector, Matrix]:
    """Return [k, b, n] and their Jacobian by [ln k', b'/k', n] (2.6, x in units of `length`)."""
    log_k = theta[0] - theta[2] * math.log(length)
    k = math.exp(min(max(log_k, -700.0), 700.0))
    ratio = theta[1] * time / length
    values = np.array([k, ratio * k, theta[2]])
    by_log_k = np.array([k, ratio * k, 0.0])
    jacobian = np.column_stack(
        [by_log_k, [0.0, k * time / length, 0.0], -math.log(length) * by_log_k + [0.0, 0.0, 1.0]]
    )
    return values, jacobian


def traced(row: RowSpec) -> tuple[Parameter, ...]:
    """Return the parameters that a row's own theta holds, a free offset apart."""
    return row.parameters if row.linear else row.declared.parameters


def physical_over_time(row: RowSpec, theta: Matrix, length: float, time: float) -> Matrix:
    """Return the parameters (samples, parameters) in rig units of scaled theta (samples, ...)."""
    names = [p.name for p in traced(row)]
    own: Matrix = theta[:, : len(names)]
    if row.linear:
        scaled: Matrix = own * _scales(row, names, length, time)
        return scaled
    values: Matrix = np.array([_hunt_crossley(one, length, time)[0] for one in own])
    return values


class Conversion:
    """What one row's scaled theta is in rig units: names and scales are found once, not a tick."""

    def __init__(self, row: RowSpec, length: float, time: float) -> None:
        self.names = [p.name for p in traced(row)]
        self._with_offset = [*self.names, "offset"]
        self._row, self._length, self._time = row, length, time
        self._scales = _scales(row, self._with_offset, length, time) if row.linear else None

    def __call__(
        self, theta: Vector, covariance: Matrix | None
    ) -> tuple[list[str], Vector, Vector | None]:
        """Return names, values and standard deviations in rig units of the row's estimate.

        theta (n,) and covariance (n, n) are scaled; a last entry beyond the row's parameters is
        the free offset. Standard deviations are by the delta method, None where covariance is.
        """
        names = self._with_offset if len(theta) > len(self.names) else self.names
        if self._scales is not None:
            scale = self._scales[: len(names)]
            values = theta * scale
            variance = None if covariance is None else scale * covariance.diagonal() * scale
        else:
            values, jacobian = _hunt_crossley(theta, self._length, self._time)
            variance = None if covariance is None else np.diag(jacobian @ covariance @ jacobian.T)
        if variance is None:
            return names, values, None
        return names, values, np.sqrt(np.maximum(variance, 0.0))
