"""Steps of the motion: velocity that jumps between two samples, and the band that they leave.

A drive that follows a jittering link moves between two samples in a way that the samples do not
show. This hidden motion lies at high frequency. Below `band_hz` the samples determine the
velocity, so there a model is judged: position and force pass the same low-pass.
"""

from __future__ import annotations

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.recordings.filters import gaussian, running_rank

_BAND_HZ = 50.0  # Hz; hands and rigs move below it
_BAND_OF_RATE = 0.05  # of the rate: below it every derivative's window passes the motion
_REACH_SIGMAS = 4.0  # deviations of the low-pass's kernel that it reaches to either side


def band_hz(dt: float) -> float:
    """Return the frequency [Hz] below which samples `dt` [s] apart show a motion in steps."""
    return min(_BAND_HZ, _BAND_OF_RATE / dt)


def reach(dt: float) -> int:
    """Return how many samples `low_passed` uses on either side of one."""
    return int(np.ceil(_REACH_SIGMAS * _deviation(dt)))


def low_passed(row: Vector, dt: float) -> Vector:
    """Return the row low-passed at `band_hz`.

    The kernel is a Gaussian: zero-phase, and short, so that little around a touch is lost.
    """
    return gaussian(row, _deviation(dt), reach(dt))


def beside(mask: Vector, dt: float) -> Vector:
    """Return the mask without the samples whose low-passed value depends on one left out."""
    return running_rank(mask, 2 * reach(dt) + 1, 0.0)


def _deviation(dt: float) -> float:
    """Return the kernel's deviation [samples]; half of the power passes at the band's edge."""
    return float(np.sqrt(np.log(2.0)) / (2.0 * np.pi * band_hz(dt)) / dt)
