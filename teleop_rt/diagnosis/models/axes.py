"""Axes of the nonlinear parameters: from 0 to 1 between their bounds, and the grids on them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from teleop_rt.contact.effect import Amplitude, Scale, Shape, Vector
from teleop_rt.diagnosis.models.model import CandidateModel, bounds


@dataclass(frozen=True)
class Axes:
    """Nonlinear parameters on axes from 0 to 1, between their bounds."""

    shapes: tuple[Shape | Amplitude, ...]
    lower: Vector
    upper: Vector

    @classmethod
    def of(cls, model: CandidateModel, scales: Mapping[Scale, float]) -> Axes:
        """Return the axes of a model's nonlinear parameters."""
        shapes = tuple(coordinate.shape for coordinate in model.coordinates)
        edges = [sorted(_to_unit_axis(s, b) for b in bounds(s, scales)) for s in shapes]
        return cls(shapes, np.array([e[0] for e in edges]), np.array([e[1] for e in edges]))

    def place(self, zeta: Vector) -> Vector:
        """Return where the parameters lie on the axes, 0 to 1 within their bounds."""
        axis = np.array([_to_unit_axis(s, z) for s, z in zip(self.shapes, zeta, strict=True)])
        return np.asarray((axis - self.lower) / (self.upper - self.lower), dtype=np.float64)

    def value(self, place: Vector) -> Vector:
        """Return the parameters at a place on the axes."""
        axis = self.lower + place * (self.upper - self.lower)
        return np.array([_from_unit_axis(s, w) for s, w in zip(self.shapes, axis, strict=True)])


def _to_unit_axis(shape: Shape | Amplitude, value: float) -> float:
    """Return the coordinate in which the parameter is searched: plain, logarithm or reciprocal."""
    if isinstance(shape, Shape) and shape.logarithmic:
        return float(np.log(value))
    if isinstance(shape, Shape) and shape.reciprocal:
        return 1.0 / value
    return float(value)


def _from_unit_axis(shape: Shape | Amplitude, axis: float) -> float:
    if isinstance(shape, Shape) and shape.logarithmic:
        return float(np.exp(axis))
    if isinstance(shape, Shape) and shape.reciprocal:
        return 1.0 / axis
    return float(axis)


def grid(shape: Shape | Amplitude, scales: Mapping[Scale, float]) -> list[float]:
    """Return the grid of a parameter on which a search starts."""
    low, high = bounds(shape, scales)
    if isinstance(shape, Amplitude):
        sizes = np.geomspace(high / 200.0, 0.8 * high, shape.points)
        return [*(-sizes[::-1] if low < 0.0 else []), *sizes]
    if shape.points == 1:
        return [shape.start]
    ends = sorted((_to_unit_axis(shape, low), _to_unit_axis(shape, high)))
    edge = 0.5 / shape.points * (ends[1] - ends[0])
    axis = np.linspace(ends[0] + edge, ends[1] - edge, shape.points)
    return [_from_unit_axis(shape, w) for w in axis]
