"""The force sensor's zero: its mean at rest in free air, with an estimate of noise and drift."""

from __future__ import annotations

import math

import numpy as np

from teleop_rt.config.reference import TareConfig
from teleop_rt.slave import faults
from teleop_rt.slave.faults import Fault


class Tare:
    """Collects forces over a fixed time, and refuses those of a contact.

    `offset` and `noise` (standard deviation about a straight line) are in the rig's unit of
    force, `drift` (slope of that line, by least squares) in that per second; NaN until then.
    """

    def __init__(self, config: TareConfig, period_s: float) -> None:
        self._config = config
        self._forces = np.zeros(max(3, round(config.duration_ms * 1e-3 / period_s)))
        self._times = np.arange(len(self._forces)) * period_s
        self._times -= self._times.mean()
        self.reset()

    def reset(self) -> None:
        """Begin again."""
        self._count = 0
        self.done = False
        self.offset = self.noise = self.drift = math.nan

    def update(self, force: float) -> Fault | None:
        """Take a valid force; return why the zero is refused, once the time is over."""
        self._forces[self._count] = force
        self._count += 1
        if self._count < len(self._forces):
            return None
        self._estimate()
        self._count = 0
        config = self._config
        if not abs(self.offset) <= config.offset_max:
            return faults.TARE_CONTACT
        if not self.noise <= config.noise_max:
            return faults.TARE_NOISE
        if not abs(self.drift) <= config.drift_max:
            return faults.TARE_DRIFT
        self.done = True
        return None

    def _estimate(self) -> None:
        forces, times = self._forces, self._times
        self.offset = float(forces.mean())
        self.drift = float(times @ forces / (times @ times))
        rest = forces - self.offset - self.drift * times
        self.noise = math.sqrt(float(rest @ rest) / (len(forces) - 2))
