"""Movements of a tool for synthetic recordings: smooth, at 10 kHz, none of it the library's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
RATE_HZ = 10_000


def _ease(u: Array) -> Array:
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**3 * (10.0 - 15.0 * u + 6.0 * u**2))


def rich(rng: np.random.Generator, depth: float, seconds: float = 10.0) -> Array:
    """Free air, approach, hold, chirp, deeper step, hold, release, multi-sine through contact."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    s = seconds / 10.0
    air = -rng.uniform(0.2, 0.4) * depth
    mean = rng.uniform(0.4, 0.55) * depth
    x = np.full(t.size, air)
    x += (mean - air) * _ease((t - 0.5 * s) / (0.5 * s))
    swing = rng.uniform(0.2, 0.3) * depth
    low, high = rng.uniform(0.5, 1.5), rng.uniform(6.0, 10.0)
    u = np.clip((t - 2.0 * s) / (3.0 * s), 0.0, 1.0)
    span = 3.0 * s
    phase = 2 * np.pi * span * (low * u + 0.5 * (high - low) * u**2)
    fade = _ease(u / 0.1) * _ease((1.0 - u) / 0.1)
    x += swing * fade * np.sin(phase) * (1.0 - 0.6 * u)
    deep = rng.uniform(0.85, 1.0) * depth
    x += (deep - mean) * _ease((t - 5.2 * s) / (0.15 * s))
    x += (air - deep) * _ease((t - 6.3 * s) / (0.4 * s))
    x += (0.35 * depth - air) * _ease((t - 7.2 * s) / (0.4 * s))
    w = np.clip((t - 7.2 * s) / (2.8 * s), 0.0, 1.0)
    tones = rng.uniform(0.6, 7.0, 5)
    weight = 0.45 * depth / np.sum(1.0 / (1.0 + tones / 3.0))
    for tone in tones:
        angle = rng.uniform(0, 2 * np.pi)
        x += weight / (1.0 + tone / 3.0) * _ease(w / 0.15) * np.sin(2 * np.pi * tone * t + angle)
    return np.asarray(x)


def sinusoid(rng: np.random.Generator, depth: float, seconds: float = 10.0) -> Array:
    """One tone in constant contact, at about 3 Hz."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    frequency, angle = rng.uniform(2.5, 3.5), rng.uniform(0, 2 * np.pi)
    return np.asarray(depth * (0.55 + 0.4 * np.sin(2 * np.pi * frequency * t + angle)))


def tapping(rng: np.random.Generator, depth: float, seconds: float = 10.0) -> Array:
    """One tone that loses contact once a cycle."""
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    frequency = rng.uniform(1.0, 3.5)
    return np.asarray(depth * (0.35 - 0.65 * np.cos(2 * np.pi * frequency * t)))


MOTIONS = {"rich": rich, "sinusoid": sinusoid, "tapping": tapping}


def jumping(shift_m: float, noise: float) -> tuple[Array, Array, Array]:
    """Return time [s], position [m] and force [N] of a tone on a damped spring at -`shift_m`.

    A damper's force jumps at each touch; `noise` is the force's standard deviation.
    """
    t = np.arange(6000) * 5e-4
    w = 2.0 * np.pi * 1.9
    x, v = 0.01 * np.sin(w * t - 1.0), 0.01 * w * np.cos(w * t - 1.0)
    force = np.where(x + shift_m > 0.0, 500.0 * (x + shift_m) + 25.0 * v, 0.0)
    return (
        np.asarray(t),
        np.asarray(x),
        np.asarray(force + noise * np.random.default_rng(2).standard_normal(t.size)),
    )
