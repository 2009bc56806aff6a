"""Movements for the second generator: hand-like, random, strokes and holds, tones; none shared."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft, rfftfreq

Array = NDArray[np.float64]
RATE_HZ = 10_000


def _smooth(row: Array, seconds: float) -> Array:
    """Return rows smoothed by a Gaussian of this width, reflected at the ends."""
    pad = np.concatenate([row, row[..., ::-1]], axis=-1)
    frequency = rfftfreq(pad.shape[-1], 1.0 / RATE_HZ)
    window = np.exp(-0.5 * (2.0 * np.pi * frequency * seconds) ** 2)
    return np.asarray(irfft(rfft(pad) * window, pad.shape[-1])[..., : row.shape[-1]])


def _random_walk(rng: np.random.Generator, t: Array) -> Array:
    """Gaussian noise of 2 to 6 Hz bandwidth, as a hand that explores."""
    width = 1.0 / (2.0 * np.pi * rng.uniform(2.0, 6.0))
    row = _smooth(rng.standard_normal(t.size), width)
    slow = _smooth(rng.standard_normal(t.size), 8.0 * width)
    return np.asarray(row / np.std(row) + 0.8 * slow / np.std(slow))


def _strokes(rng: np.random.Generator, t: Array) -> Array:
    """Moves of least jerk between random depths, with holds of random length."""
    times, levels = [0.0], [-1.5]
    while times[-1] < t[-1]:
        hold, move = rng.uniform(0.05, 0.9), rng.uniform(0.08, 0.6)
        goal = rng.uniform(-1.8, 2.0)
        times += [times[-1] + hold, times[-1] + hold + move]
        levels += [levels[-1], goal]
    row = np.empty_like(t)
    for i in range(len(times) - 1):
        part = (t >= times[i]) & (t < times[i + 1])
        u = (t[part] - times[i]) / (times[i + 1] - times[i])
        row[part] = levels[i] + (levels[i + 1] - levels[i]) * u**3 * (10 - 15 * u + 6 * u**2)
    return _smooth(row, 0.008)


def _tones(rng: np.random.Generator, t: Array) -> Array:
    """Nine tones from 0.2 to 9 Hz with falling amplitudes."""
    tones = np.geomspace(0.2, 9.0, 9) * rng.uniform(0.85, 1.15, 9)
    row = np.zeros_like(t)
    for tone in tones:
        row += np.cos(2 * np.pi * tone * t + rng.uniform(0, 2 * np.pi)) / (1.0 + tone / 1.5)
    return np.asarray(row / np.std(row))


def _hand(rng: np.random.Generator, t: Array) -> Array:
    """Pressing by hand at 1 to 3 Hz, frequency and amplitude wandering, with pauses."""
    wander = _smooth(rng.standard_normal((2, t.size)), 0.4)
    wander /= np.std(wander, axis=1, keepdims=True)
    rate = np.clip(rng.uniform(1.2, 2.5) + 0.6 * wander[0], 0.2, 4.0)
    phase = 2 * np.pi * np.cumsum(rate) / RATE_HZ
    size = 1.0 + 0.4 * wander[1]
    tremor = _smooth(rng.standard_normal(t.size), 0.016)
    return np.asarray(size * np.sin(phase) + 0.02 * tremor / np.std(tremor))


def _swept(rng: np.random.Generator, t: Array) -> Array:
    """A sweep up and down in frequency on a triangle of slow presses."""
    u = t / t[-1]
    low, high = rng.uniform(0.2, 0.6), rng.uniform(5.0, 12.0)
    rate = low * (high / low) ** (1.0 - np.abs(2.0 * u - 1.0))
    fast = np.sin(2 * np.pi * np.cumsum(rate) / RATE_HZ) / (1.0 + rate / 2.0)
    slow = 2.0 / np.pi * np.arcsin(np.sin(2 * np.pi * rng.uniform(0.15, 0.4) * t - 1.2))
    return _smooth(1.2 * fast + 1.2 * slow, 0.01)


MOTIONS = {
    "random": _random_walk, "strokes": _strokes, "tones": _tones, "hand": _hand, "swept": _swept,
}  # fmt: skip


def _tone(rng: np.random.Generator, t: Array) -> Array:
    frequency = np.exp(rng.uniform(np.log(0.5), np.log(8.0)))
    return np.asarray(np.sin(2 * np.pi * frequency * t + _angle(rng)))


def _two_tones(rng: np.random.Generator, t: Array) -> Array:
    slow = rng.uniform(0.5, 2.5)
    fast = np.sin(2 * np.pi * slow * rng.uniform(1.6, 4.0) * t + _angle(rng))
    return np.asarray(np.sin(2 * np.pi * slow * t + _angle(rng)) + rng.uniform(0.2, 0.6) * fast)


def _ramps(rng: np.random.Generator, t: Array) -> Array:
    """Up and down at two constant speeds, round for a few hundredths of a second."""
    cycle, share = rng.uniform(0.5, 3.0), rng.uniform(0.25, 0.75)
    u = (t / cycle + rng.random()) % 1.0
    return _smooth(np.minimum(u / share, (1.0 - u) / (1.0 - share)), rng.uniform(0.005, 0.03))


def _holds(rng: np.random.Generator, t: Array) -> Array:
    """Constant depths, a second or more each."""
    number = int(t[-1]) + 2
    ends = np.cumsum(rng.uniform(0.8, 2.5, number))
    return _smooth(rng.uniform(0.0, 1.0, number)[np.searchsorted(ends, t)], rng.uniform(0.02, 0.06))


def _angle(rng: np.random.Generator) -> float:
    return float(rng.uniform(0, 2 * np.pi))


NARROW = {"tone": _tone, "two tones": _two_tones, "ramps": _ramps, "holds": _holds}


def movement(
    rng: np.random.Generator, kind: str, depth: float, seconds: float, air: float
) -> tuple[Array, Array]:
    """Return time and penetration: `depth` at most, the share `air` of the time above it.

    Where `air` is not above 0 the tool stays in contact, by the share -`air` of its stroke.
    """
    t = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    row = (MOTIONS | NARROW)[kind](rng, t)
    surface = float(np.quantile(row, air) if air > 0.0 else np.min(row) + air * np.ptp(row))
    row = row - surface
    return t, depth * row / float(np.max(row))
