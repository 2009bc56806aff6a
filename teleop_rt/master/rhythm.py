"""Prediction of a surface that moves in a rhythm, over the delay of its news.

A bank of oscillators, one a period, each with a second harmonic, a constant and a drift, follows
the surface by recursive least squares with a memory of about its period. Each is judged by the
motion that it predicted a delay ago, and so is the straight line that needs no rhythm; the
best oscillator counts only while its errors are a fraction of the line's. A rhythm ends at any
moment: a motion that leaves the prediction of a tenth of a second ago by a share of its size is
taken as none for a period.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHORTEST_S, LONGEST_S, PERIODS = 1.0, 10.0, 96
"""Periods of breath, in steps of 2.5 %: one between two errs by 4 % of the motion in a third."""
MEMORY_PERIODS, LEAST_PERIODS, JUDGED_PERIODS = 1.2, 1.2, 0.3
"""Of its own: an oscillator's memory, and how long it is fed, and judged, until it counts."""
UNKNOWN = 1e3
"""Variance of a state of which nothing is known, in variances of a sample."""
SAMPLE_S, CONTIGUOUS_S = 0.04, 0.15
"""Least time between samples, and the longest across which they are interpolated."""
SETTLES_S = 0.12
"""After an onset a surface is off by up to a millimetre for so long."""
GAIN = 0.5
"""Largest error of a rhythm that counts, as a share of the straight line's."""
SOON_S, LEFT_SHARE = 0.1, 0.1
"""Horizon at which the end of a rhythm is watched for, and the deviation there that is one, as a
share of the motion's size."""
REST_PERIODS = 1.0
"""How long a rhythm does not count after its end."""
STATES = 6
"""Of each period tried: a constant with its rate, and two parts of both harmonics."""
_SEEN: Array = np.array([1.0, 0.0, 1.0, 0.0, 1.0, 0.0])
"""The surface is the constant and the first part of both harmonics."""


class Moving(NamedTuple):
    """Place and velocity of a surface."""

    surface: float
    velocity: float


class Rhythm:
    """Predicts a surface, from samples of it that are a delay old. Rig units and seconds."""

    def __init__(self) -> None:
        self._periods_s: Array = np.geomspace(SHORTEST_S, LONGEST_S, PERIODS)
        self._omega: Array = 2 * np.pi / self._periods_s
        self.reset()

    def reset(self) -> None:
        """Forget the surface."""
        self._x = np.zeros((PERIODS, STATES))
        self._p = np.broadcast_to(UNKNOWN * np.eye(STATES), (PERIODS, STATES, STATES)).copy()
        self._error, self._line_error = np.zeros(PERIODS), np.zeros(PERIODS)
        self._judged: Array = np.zeros(PERIODS)
        self._fed_s = self._rests_until_s = 0.0
        self._sampled_s, self._sample, self._base = -math.inf, 0.0, 0.0
        self._met_s = math.inf
        self._late: deque[tuple[float, Array, float]] = deque()
        self._soon: deque[tuple[float, Array, float]] = deque()
        self._best = -1

    @property
    def period_s(self) -> float:
        """The period by which the surface is predicted; 0 where it is not."""
        return float(self._periods_s[self._best]) if self._best >= 0 else 0.0

    def follow(
        self, now_s: float, seen: float, late_s: float, line: float, *, felt: bool
    ) -> Moving | None:
        """Take in a surface as it was `late_s` ago, and return it as it is; None without a rhythm.

        `line` is where a straight line has it now; `felt` says that the tool was in contact, and
        the surface more than a guess. Without contact the rhythm goes on by itself for a period.
        """
        self._met_s = min(self._met_s, now_s) if felt else math.inf
        settled = now_s - self._met_s >= SETTLES_S
        if settled and now_s - self._sampled_s >= SAMPLE_S:
            self._take(now_s, seen, late_s, line)
        since_s = now_s - self._sampled_s
        if self._best < 0 or since_s > self.period_s:
            return None
        values, rates = self._ahead(since_s + late_s)
        surface = float(values[self._best]) + self._base
        if settled:
            surface = seen + float((values - self._ahead(since_s)[0])[self._best])
        return Moving(surface, float(rates[self._best]))

    def _take(self, now_s: float, seen: float, late_s: float, line: float) -> None:
        if math.isinf(self._sampled_s):
            self._base, self._sampled_s = seen, now_s
        y, dt_s = seen - self._base, now_s - self._sampled_s
        self._judge(now_s, y, dt_s)
        self._correct(y, dt_s)
        self._sampled_s, self._sample = now_s, y
        self._fed_s += min(dt_s, CONTIGUOUS_S)
        here = self._ahead(0.0)[0] - y
        known = self._fed_s >= LEAST_PERIODS * self._periods_s
        ahead = np.where(known, self._ahead(late_s)[0] - here, math.nan)
        self._late.append((now_s + late_s, ahead, line - self._base))
        self._soon.append((now_s + SOON_S, self._ahead(SOON_S)[0] - here, 0.0))
        self._choose(now_s)

    def _ahead(self, time_s: float) -> tuple[Array, Array]:
        """Return each oscillator's value a time after the last sample, and its rate."""
        x, values, rates = self._x, self._x[:, 0] + time_s * self._x[:, 1], self._x[:, 1].copy()
        for harmonic in (1, 2):
            omega = harmonic * self._omega
            cosine, sine = np.cos(omega * time_s), np.sin(omega * time_s)
            a, b = x[:, 2 * harmonic], x[:, 2 * harmonic + 1]
            values = values + a * cosine + b * sine
            rates += omega * (b * cosine - a * sine)
        return values, rates

    def _correct(self, y: float, dt_s: float) -> None:
        """Turn the oscillators by a time, forget as much, and take in a sample."""
        turn = np.broadcast_to(np.eye(STATES), self._p.shape).copy()
        turn[:, 0, 1] = dt_s
        for i in (2, 4):
            angle = 0.5 * i * self._omega * dt_s
            cosine, sine = np.cos(angle), np.sin(angle)
            turn[:, i, i] = turn[:, i + 1, i + 1] = cosine
            turn[:, i, i + 1], turn[:, i + 1, i] = sine, -sine
        self._x = np.einsum("nij,nj->ni", turn, self._x)
        self._p = turn @ self._p @ turn.transpose(0, 2, 1)
        forgotten = np.exp(min(dt_s, CONTIGUOUS_S) / (MEMORY_PERIODS * self._periods_s))
        known = np.einsum("nii->n", self._p) < UNKNOWN
        self._p *= np.where(known, forgotten, 1.0)[:, None, None]
        gain = self._p @ _SEEN
        spread = 1.0 + gain @ _SEEN
        self._x += gain * ((y - self._x @ _SEEN) / spread)[:, None]
        self._p -= gain[:, :, None] * gain[:, None, :] / spread[:, None, None]

    def _judge(self, now_s: float, y: float, dt_s: float) -> None:
        """Compare the prediction for the time since the last sample with the new sample."""
        for due_s, rhythms, line in self._due(self._late, now_s):
            if dt_s > CONTIGUOUS_S:
                continue
            came = y + (due_s - now_s) / dt_s * (y - self._sample)
            judged = np.isfinite(rhythms)
            self._judged += judged
            share = np.maximum(1.0 / np.maximum(self._judged, 1.0), SAMPLE_S / self._periods_s)
            self._error += share * np.nan_to_num((rhythms - came) ** 2 - self._error)
            self._line_error += share * judged * ((line - came) ** 2 - self._line_error)
        for due_s, rhythms, _ in self._due(self._soon, now_s):
            if dt_s > CONTIGUOUS_S or self._best < 0:
                continue
            came = y + (due_s - now_s) / dt_s * (y - self._sample)
            size = float(np.hypot(*self._x[self._best, 2:4]) + np.hypot(*self._x[self._best, 4:6]))
            if abs(float(rhythms[self._best]) - came) > LEFT_SHARE * size:
                self._rests_until_s, self._best = now_s + REST_PERIODS * self.period_s, -1

    @staticmethod
    def _due(
        promises: deque[tuple[float, Array, float]], now_s: float
    ) -> Iterator[tuple[float, Array, float]]:
        while promises and promises[0][0] <= now_s:
            yield promises.popleft()

    def _choose(self, now_s: float) -> None:
        """Choose the oscillator that predicted best, if it predicted well."""
        known = self._judged * SAMPLE_S >= JUDGED_PERIODS * self._periods_s
        good = known & (self._error < GAIN**2 * self._line_error)
        if now_s < self._rests_until_s or not good.any():
            self._best = -1
            return
        self._best = int(np.argmin(np.where(good, self._error, np.inf)))
