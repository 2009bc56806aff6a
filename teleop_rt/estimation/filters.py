"""The differentiator: one filter for every regressor and for y.

A state-variable filter, a stationary Kalman filter, or first-order adaptive windowing (FOAW):
each gives a signal's filtered value, rate and curvature with a stated lag and noise gain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.kernels.jit import kernel

Matrix = NDArray[np.float64]

# A channel of the filter: value, first and second derivative, and the input before.
VALUE, RATE, CURVATURE, INPUT, CHANNEL_SIZE = range(5)
LONGEST_WINDOW = 64
"""Samples of the window of adaptive windowing, for which the kernel has room."""
_SERIES = 40
"""Terms of exp's series: 7^40/40! < 1e-14."""


@dataclass(frozen=True, slots=True)
class DesignedFilter:
    """A discretised filter with its delay and noise gain.

    transition (3, 3), gain_before (3,), gain_now (3,) advance (value, rate, curvature) of a linear
    filter; window > 0 is the longest window [ticks] of FOAW instead. lag_s is the delay at low
    frequency (FOAW: of the longest window); the noise gains are the standard deviations of rate
    and curvature per unit of white noise on the input [1/s, 1/s^2]; settle_ticks is how long a
    start-up transient lasts.
    """

    transition: Matrix
    gain_before: Vector
    gain_now: Vector
    window: int
    lag_s: float
    velocity_noise_gain: float
    acceleration_noise_gain: float
    settle_ticks: int


def design(kind: str, cutoff_hz: float, period_s: float) -> DesignedFilter:
    """Design the differentiator `kind`: svf, kalman or foaw.

    Raises ValueError for another kind, or a cutoff that is not below a third of the rate.
    """
    if not 0.0 < cutoff_hz < 1.0 / (3.0 * period_s):
        raise ValueError(f"cutoff {cutoff_hz} Hz must be above 0 and below a third of the rate")
    designs = {"svf": state_variable_filter, "kalman": kalman_filter, "foaw": adaptive_windowing}
    if kind not in designs:
        raise ValueError(f"unknown differentiator {kind!r}; one of: {', '.join(designs)}")
    return designs[kind](cutoff_hz, period_s)


def state_variable_filter(cutoff_hz: float, period_s: float) -> DesignedFilter:
    """Design a Butterworth filter of order 3 whose states are the value and two derivatives.

    The input counts as linear between samples, so rate and curvature are exact derivatives of the
    filtered value: regressors and y keep their relation.
    """
    w = 2.0 * math.pi * cutoff_hz
    # The system in the filter's own time, augmented by the input and its slope over a period
    # (first-order hold); then its derivatives by seconds.
    system = np.zeros((5, 5))
    system[:3, :4] = [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-1.0, -2.0, -2.0, 1.0]]
    system *= w * period_s
    system[3, 4] = 1.0
    held = _exponential(system)
    scale = w ** np.arange(3)
    now = held[:3, 4] * scale
    transition = held[:3, :3] * np.outer(scale, 1.0 / scale)
    return _linear(transition, held[:3, 3] * scale - now, now, cutoff_hz, period_s)


def _exponential(matrix: Matrix) -> Matrix:
    """Return exp of a matrix of norm below 7 by its series.

    `scipy.linalg.expm` is as exact; to load it takes a tenth of the time that a daemon starts in.
    """
    total = term = np.eye(len(matrix))
    for power in range(1, _SERIES):
        term = term @ matrix / power
        total = total + term
    return total


def kalman_filter(cutoff_hz: float, period_s: float) -> DesignedFilter:
    """Design the stationary Kalman filter of a signal driven by white jerk.

    The ratio of jerk to measurement noise is the one whose poles lie at the cutoff. Its value has
    no lag for any parabola; rate and value are filtered equally only in the pass-band.
    """
    w = 2.0 * math.pi * cutoff_hz
    T = period_s
    A = np.array([[1.0, T, T * T / 2.0], [0.0, 1.0, T], [0.0, 0.0, 1.0]])
    jerk = np.array([T**3 / 6.0, T * T / 2.0, T])
    H = np.array([[1.0, 0.0, 0.0]])
    from scipy import linalg  # noqa: PLC0415 - a daemon on the state-variable filter needs it not

    predicted = linalg.solve_discrete_are(A.T, H.T, w**6 * np.outer(jerk, jerk), np.eye(1))
    gain = (predicted @ H.T / (H @ predicted @ H.T + 1.0))[:, 0]
    transition = (np.eye(3) - np.outer(gain, H)) @ A
    return _linear(transition, np.zeros(3), gain, cutoff_hz, period_s)


def adaptive_windowing(cutoff_hz: float, period_s: float) -> DesignedFilter:
    """Design FOAW (Janabi-Sharifi, Hayward, Chen 2000): the longest window that fits a line.

    Value, rate and curvature are those of the signal averaged twice over the window, whose length
    follows the position alone, so all channels share it.
    """
    window = min(max(round(0.32 / (cutoff_hz * period_s)), 1), LONGEST_WINDOW)
    span = window * period_s
    return DesignedFilter(
        transition=np.zeros((3, 3)),
        gain_before=np.zeros(3),
        gain_now=np.zeros(3),
        window=window,
        lag_s=span,
        velocity_noise_gain=math.sqrt(2.0 * window - 1.5) / (window * span),
        acceleration_noise_gain=math.sqrt(6.0) / span**2,
        settle_ticks=2 * window + 1,
    )


def _linear(
    transition: Matrix, before: Vector, now: Vector, cutoff_hz: float, period_s: float
) -> DesignedFilter:
    """Return a linear filter with its lag and noise gains, measured on its impulse response."""
    state = now.copy()
    drive = before
    power, moment, step = np.zeros(3), 0.0, 0
    settle = math.ceil(14.0 / (2.0 * math.pi * cutoff_hz * period_s))
    while step < settle * 20:
        power += state**2
        moment += step * state[VALUE]
        state = transition @ state + drive
        drive = np.zeros(3)
        step += 1
    return DesignedFilter(
        transition=np.ascontiguousarray(transition),
        gain_before=np.ascontiguousarray(before),
        gain_now=np.ascontiguousarray(now),
        window=0,
        lag_s=float(moment) * period_s,
        velocity_noise_gain=float(math.sqrt(power[RATE])),
        acceleration_noise_gain=float(math.sqrt(power[CURVATURE])),
        settle_ticks=settle,
    )


@kernel
def start_channel(channel: Vector, ring: Vector, size: int, u: float) -> None:
    """Start a channel at rest at the input u; ring is its memory for FOAW, of `size` samples."""
    channel[VALUE] = u
    channel[RATE] = 0.0
    channel[CURVATURE] = 0.0
    channel[INPUT] = u
    for i in range(size):
        ring[i] = u


@kernel
def advance_channel(
    channel: Vector, u: float, transition: Matrix, before: Vector, now: Vector
) -> None:
    """Advance a channel of a linear filter by one period to the input u."""
    z0, z1, z2, u0 = channel[VALUE], channel[RATE], channel[CURVATURE], channel[INPUT]
    for i in range(3):
        channel[i] = (
            transition[i, 0] * z0
            + transition[i, 1] * z1
            + transition[i, 2] * z2
            + before[i] * u0
            + now[i] * u
        )
    channel[INPUT] = u


@kernel
def push(ring: Vector, size: int, u: float) -> None:
    """Shift a sample into the first `size` places of a ring, newest first."""
    for i in range(size - 1, 0, -1):
        ring[i] = ring[i - 1]
    ring[0] = u


@kernel
def longest_line(ring: Vector, longest: int, resolution: float) -> int:
    """Return the longest window whose samples all lie within `resolution` of a line.

    The line runs through the window's end points (FOAW, end-fit).
    """
    for n in range(2, longest + 1):
        slope = (ring[n] - ring[0]) / n
        for i in range(1, n):
            if abs(ring[i] - ring[0] - slope * i) > resolution:
                return n - 1
    return longest


@kernel
def window_channel(channel: Vector, ring: Vector, n: int, period: float) -> None:
    """Set value, rate and curvature of the ring's signal averaged twice over n ticks."""
    value = 0.25 * (ring[0] + ring[2 * n]) + (n - 0.5) * ring[n]
    newer = 0.5 * (ring[0] + ring[n])
    older = 0.5 * (ring[n] + ring[2 * n])
    for i in range(1, n):
        value += i * (ring[i] + ring[2 * n - i])
        newer += ring[i]
        older += ring[n + i]
    span = n * period
    channel[VALUE] = value / (n * n)
    channel[RATE] = (newer - older) / (n * span)
    channel[CURVATURE] = (ring[0] - 2.0 * ring[n] + ring[2 * n]) / (span * span)
    channel[INPUT] = ring[0]
