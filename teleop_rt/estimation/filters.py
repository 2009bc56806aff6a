"""The differentiator: a state-variable filter that every regressor and y pass through alike."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from teleop_rt.contact.effect import Vector
from teleop_rt.jit import kernel

# A channel of the filter: value, first and second derivative, and the input before.
VALUE, RATE, CURVATURE, INPUT, CHANNEL_SIZE = range(5)


@dataclass(frozen=True, slots=True)
class Differentiator:
    """A discretised filter with what it costs.

    transition (3, 3), gain_before (3,), gain_now (3,) advance (value, rate, curvature); lag_s is
    its delay at low frequency; velocity_noise_gain is the standard deviation of the rate per unit
    of white noise on the input [1/s]; settle_ticks is how long a start-up transient lasts.
    """

    transition: NDArray[np.float64]
    gain_before: Vector
    gain_now: Vector
    lag_s: float
    velocity_noise_gain: float
    acceleration_noise_gain: float
    settle_ticks: int


def state_variable_filter(cutoff_hz: float, period_s: float) -> Differentiator:
    """Design a Butterworth filter of order 3 whose states are the value and two derivatives.

    The input counts as linear between samples, so rate and curvature are exact derivatives of the
    filtered value: regressors and y keep their relation. Raises ValueError when the cutoff is not
    below a third of the sampling rate.
    """
    if not 0.0 < cutoff_hz < 1.0 / (3.0 * period_s):
        raise ValueError(f"cutoff {cutoff_hz} Hz must be above 0 and below a third of the rate")
    w = 2.0 * math.pi * cutoff_hz
    A = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(w**3), -2 * w * w, -2 * w]])
    B = np.array([0.0, 0.0, w**3])
    # exp of the system augmented by the input and its slope (first-order hold).
    system = np.zeros((5, 5))
    system[:3, :3], system[:3, 3], system[3, 4] = A * period_s, B * period_s, 1.0
    held = expm(system)
    now = held[:3, 4]
    before = held[:3, 3] - now
    transition = np.ascontiguousarray(held[:3, :3])
    gains = _noise_gains(transition, before, now)
    return Differentiator(
        transition=transition,
        gain_before=np.ascontiguousarray(before),
        gain_now=np.ascontiguousarray(now),
        lag_s=2.0 / w,
        velocity_noise_gain=gains[RATE],
        acceleration_noise_gain=gains[CURVATURE],
        settle_ticks=math.ceil(14.0 / (w * period_s)),
    )


def _noise_gains(transition: NDArray[np.float64], before: Vector, now: Vector) -> list[float]:
    """Return the standard deviation of each output per unit of white noise on the input."""
    state = now.copy()
    power = state**2
    drive = before
    while np.any(state**2 > 1e-12 * power):
        state = transition @ state + drive
        power += state**2
        drive = np.zeros(3)
    return [float(g) for g in np.sqrt(power)]


@kernel
def start_channel(channel: Vector, u: float) -> None:
    """Start a channel at rest at the input u."""
    channel[VALUE] = u
    channel[RATE] = 0.0
    channel[CURVATURE] = 0.0
    channel[INPUT] = u


@kernel
def advance_channel(
    channel: Vector, u: float, transition: NDArray[np.float64], before: Vector, now: Vector
) -> None:
    """Advance a channel by one period to the input u."""
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
