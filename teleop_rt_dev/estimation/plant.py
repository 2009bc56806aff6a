"""A plain plant for tests: a motion in closed form, contact force from it, sensors with faults."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Law = Callable[[Array, Array], Array]

RATE = 1000.0  # Hz, of the shipped rigs


@dataclass(frozen=True)
class Press:
    """A tool that comes out of free air, oscillates in contact, and lifts off now and then."""

    duration: float = 10.0
    surface: float = 0.0137
    mean: float = 0.012
    amplitude: float = 0.008
    frequency: float = 3.0
    lift_every: float = 4.0
    ramp: float = 0.6

    def position(self, t: Array) -> Array:
        phase = np.mod(t, self.lift_every)
        low = -0.005
        out = self.lift_every - self.ramp
        swing = np.minimum(1.0, np.maximum(phase - self.ramp, 0.0) / 0.3)

        def contact(c: Array | float) -> Array:
            angle = 2 * np.pi * self.frequency * (c - self.ramp)
            return np.asarray(self.mean + self.amplitude * np.sin(angle))

        def smooth(s: Array) -> Array:
            return s * s * (3 - 2 * s)

        down = low + smooth(np.clip(phase / self.ramp, 0, 1)) * (self.mean - low)
        steady = self.mean + swing * (contact(phase) - self.mean)
        up = low + smooth(np.clip((self.lift_every - phase) / self.ramp, 0, 1)) * (
            contact(out) - low
        )
        value = np.where(phase < self.ramp, down, np.where(phase < out, steady, up))
        return np.asarray(self.surface + value)

    def state(self, t: Array) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration by central differences of the closed form."""
        h = 1e-5
        before, now, after = self.position(t - h), self.position(t), self.position(t + h)
        return now, (after - before) / (2 * h), (after - 2 * now + before) / (h * h)


def kelvin_voigt(x: Array, v: Array, k: float = 3600.0, b: float = 20.0) -> Array:
    return np.where(x > 0, np.maximum(k * x + b * v, 0.0), 0.0)


def hunt_crossley(
    x: Array, v: Array, k: float = 30000.0, b: float = 500.0, n: float = 1.5
) -> Array:
    return np.where(x > 0, np.maximum(np.maximum(x, 0) ** n * (k + b * v), 0.0), 0.0)


def record(
    press: Press,
    law: Law,
    seed: int = 0,
    lag: float = 1e-3,
    noise: float = 0.05,
    resolution: float = 5e-6,
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return position (quantised), force (late by `lag`, noisy) and valid."""
    t = np.arange(int(press.duration * RATE)) / RATE
    late, v, _ = press.state(t - lag)
    force = law(late - press.surface, v)
    noisy = force + noise * np.random.default_rng(seed).normal(size=len(t))
    position = np.round(press.position(t) / resolution) * resolution
    return position, noisy, np.ones(len(t), dtype=bool)
