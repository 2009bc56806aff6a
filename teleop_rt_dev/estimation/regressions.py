"""Regressions written from the report's equations with numpy, for whole analytic motions."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
AnalyticMotion = tuple[Array, Array, Array, Array]
"""Times [s], positions, velocities and accelerations."""

RATE = 1000.0  # Hz, of the shipped rigs


def sine(
    frequency: float = 3.0,
    mean: float = 0.012,
    amplitude: float = 0.008,
    duration: float = 1.0,
    rate: float = RATE,
) -> AnalyticMotion:
    t = np.arange(round(duration * rate)) / rate
    w = 2 * np.pi * frequency
    x = mean + amplitude * np.sin(w * t)
    return t, x, amplitude * w * np.cos(w * t), -amplitude * w * w * np.sin(w * t)


def rich(duration: float = 1.0, rate: float = RATE) -> AnalyticMotion:
    """Three tones about an offset, in units near one: position, velocity, acceleration."""
    t = np.arange(round(duration * rate)) / rate
    x, v, a = np.full_like(t, 2.4), np.zeros_like(t), np.zeros_like(t)
    for amplitude, frequency, phase in ((1.0, 3.0, 0.3), (0.4, 11.0, 1.0), (0.2, 23.0, 2.0)):
        w = 2 * np.pi * frequency
        x += amplitude * np.sin(w * t + phase)
        v += amplitude * w * np.cos(w * t + phase)
        a -= amplitude * w * w * np.sin(w * t + phase)
    return t, x, v, a


def integral(t: Array, values: Array) -> Array:
    steps = np.diff(t) * (values[1:] + values[:-1]) / 2
    return np.concatenate([[0.0], np.cumsum(steps)])


def direct(model: str, x: Array, v: Array, a: Array, f: Array) -> tuple[Array, Array]:
    """Return phi (samples, n) and y (samples,)."""
    if model == "mass":
        return a[:, None], f
    if model == "kelvin-voigt":
        return np.column_stack([x, v]), f
    if model == "kelvin-voigt-unilateral":
        return np.column_stack([x, np.maximum(v, 0)]), f
    if model == "mass-spring-damper":
        return np.column_stack([a, x, v]), f
    return np.column_stack([np.ones_like(x), v, np.log(x)]), np.log(f)


def algebraic(model: str, t: Array, x: Array, f: Array) -> tuple[Array, Array]:
    """Return phi and y of 3.20, 3.24, 3.28, 3.31."""

    def once(g: Array) -> Array:
        return integral(t, g)

    def twice(g: Array) -> Array:
        return integral(t, integral(t, g))

    if model == "kelvin-voigt":
        return np.column_stack([once(t * x), t * x - once(x)]), once(t * f)
    if model == "hunt-crossley":
        phi = [once(t), t * x - once(x), once(t * np.log(x))]
        return np.column_stack(phi), once(t * np.log(f))
    mass = t * t * x - 4 * once(t * x) + 2 * twice(x)
    y = twice(t * t * f)
    if model == "mass":
        return mass[:, None], y
    return np.column_stack([mass, twice(t * t * x), once(t * t * x) - 2 * twice(t * x)]), y


def force(model: str, theta: Sequence[float], x: Array, v: Array, a: Array) -> Array:
    if model == "mass":
        return theta[0] * a
    if model == "kelvin-voigt":
        return theta[0] * x + theta[1] * v
    if model == "kelvin-voigt-unilateral":
        return theta[0] * x + theta[1] * np.maximum(v, 0)
    if model == "mass-spring-damper":
        return theta[0] * a + theta[1] * x + theta[2] * v
    k, b, n = theta
    return np.asarray(x**n * (k + b * v))
