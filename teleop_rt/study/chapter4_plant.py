"""The motion and the contact forces of the studies, in closed form: no code of the estimators."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Signal = NDArray[np.float64]
RATE_HZ = 1000.0  # the report's, chapter 4
TRUTH = {
    "kelvin-voigt": {"k": 1500.0, "b": 50.0},
    "hunt-crossley": {"k": 1500.0, "b": 50.0, "n": 1.5},
}
"""Table 4.1."""


class PenetrationMotion(NamedTuple):
    """Time [s], penetration [m] and its derivatives, each (n,)."""

    t: Signal
    x: Signal
    v: Signal
    a: Signal


@dataclass(frozen=True, slots=True)
class Sine:
    """The position profile of figure 4.1 [Hz, m, s]."""

    frequency_hz: float = 3.0
    mean: float = 0.012
    amplitude: float = 0.008
    duration_s: float = 10.0

    def at(self, t: Signal) -> PenetrationMotion:
        """Return the motion at times t (n,)."""
        w = 2.0 * np.pi * self.frequency_hz
        swing = self.amplitude * np.sin(w * t)
        return PenetrationMotion(
            t, self.mean + swing, self.amplitude * w * np.cos(w * t), -w * w * swing
        )

    def samples(self) -> PenetrationMotion:
        """Return the motion at every sample."""
        return self.at(np.arange(round(self.duration_s * RATE_HZ)) / RATE_HZ)


def plant_force(
    model: str, truth: Mapping[str, float | Signal], motion: PenetrationMotion
) -> Signal:
    """Return the force (n,) of Kelvin-Voigt (2.1), with a mass (2.3), or Hunt-Crossley (2.4)."""
    if model == "hunt-crossley":
        depth = np.maximum(motion.x, 0.0)
        return depth ** truth["n"] * (truth["k"] + truth["b"] * motion.v)
    return truth["k"] * motion.x + truth["b"] * motion.v + truth.get("m", 0.0) * motion.a


@dataclass(frozen=True, slots=True)
class SensorErrors:
    """Errors of the sensors: force noise [N], encoder step [m], lag of the force [s]."""

    force_noise: float = 0.0
    resolution: float = 0.0
    lag_s: float = 0.0

    def record(
        self, profile: Sine, model: str, truth: dict[str, float], seed: int
    ) -> tuple[Signal, Signal]:
        """Return position and force (n,) as they are measured."""
        motion = profile.samples()
        late = plant_force(model, truth, profile.at(motion.t - self.lag_s))
        noise = np.random.default_rng(seed).normal(size=late.size)
        position = motion.x
        if self.resolution > 0.0:
            position = np.round(position / self.resolution) * self.resolution
        return position, late + self.force_noise * noise
