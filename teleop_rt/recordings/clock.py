"""The clock of a recording: the period of its samples, and the jitter of their stamps."""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.recordings.filters import pieces
from teleop_rt.recordings.resampling import GAP

_CLOCK_FITS = 3  # of a line through the stamps; the ticks change no more after the second
_SMOOTHER = 0.5  # of the other's third differences; interpolation alone smooths noise to 0.7


def ticks_of(t: Vector, dt: float, position: Vector) -> tuple[Vector, float]:
    """Return times and period [s] of the clock that took the samples, `dt` being near its period.

    Stamps that jitter by less than half a period count its ticks: their median step is off by some
    of the jitter, which adds up, and a line through them is not. The samples lie on that line, or
    where the stamps say if only the stamps were late: so as the position is the smoother.
    """
    steps = np.diff(t, prepend=t[0])
    steps /= dt
    ticks = np.round(steps)
    np.copyto(ticks, steps > 0.0, where=steps < GAP)
    del steps
    np.cumsum(ticks, out=ticks)
    elapsed = t - t[0]
    for _ in range(_CLOCK_FITS):
        period, start = _line(ticks, elapsed)
        ticks = elapsed - start
        ticks /= period
        np.round(ticks, out=ticks)
    del elapsed  # an hour's row takes 29 MB
    if np.any(ticks[1:] - ticks[:-1] < 1.0):
        return t, dt
    even = ticks
    even *= period
    even += t[0] + start
    off = t - even
    if float(max(np.max(off), -np.min(off))) >= 0.5 * period:
        return t, dt
    del off, ticks
    as_stamped, as_ticked = (_roughness(times, position, even[0], period) for times in (t, even))
    return (t if as_stamped < _SMOOTHER * as_ticked else even), period


def jitter_of(t: Vector, dt: float) -> float:
    """Return how far times lie from the ticks of a clock, as a share of its period."""
    off = (t - t[0]) / dt
    off -= np.round(off)
    return float(np.std(off))


def _roughness(t: Vector, position: Vector, first: float, period: float) -> float:
    """Return the deviation of the position's third differences, `period` apart from `first` on."""
    total, count = 0.0, round(float(t[-1] - first) / period) + 1
    for part in pieces(count - 3):
        here = first + period * np.arange(part.start, part.stop + 3)
        third = np.diff(np.interp(here, t, position), 3)
        total += float(third @ third)
    return float(np.sqrt(total / (count - 3)))


def _line(x: Vector, y: Vector) -> tuple[float, float]:
    """Return slope and value at 0 of the line of least squares, in a sixth of polyfit's room."""
    middle = float(np.mean(x))
    away = x - middle
    slope = float(away @ y) / float(away @ away)
    return slope, float(np.mean(y)) - slope * middle
