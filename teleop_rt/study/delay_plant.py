"""The plant of the delay study: ideal materials, and an axis without a bus."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import Sample

Array = NDArray[np.float64]
EnvironmentName = Literal["foam", "silicone", "stiff", "step"]

PERIOD_S = 1e-3  # of the shipped rigs
SURFACE_M = 0.0083
"""Between two strides of the hand, so that it is met in motion."""
DRIVE_HZ = 100.0
"""Bandwidth of the position loop, and sensors like those of the simulated rigs."""
FORCE_NOISE_N, RESOLUTION_M = 0.05, 5e-6  # standard deviation, and step of the encoder


@dataclass(frozen=True, slots=True)
class Material:
    """A Kelvin-Voigt environment, (2.1): N/m and N s/m."""

    k: float
    b: float

    def force(self, x: Array | float, v: Array | float) -> Array:
        """Return the force at penetration x, which never pulls."""
        return np.where(np.asarray(x) > 0, np.maximum(0.0, self.k * x + self.b * v), 0.0)


MATERIALS: dict[EnvironmentName, tuple[Material, Material]] = {
    "foam": (Material(400.0, 3.0), Material(400.0, 3.0)),
    "silicone": (Material(3600.0, 20.0), Material(3600.0, 20.0)),
    "stiff": (Material(20_000.0, 40.0), Material(20_000.0, 40.0)),
    "step": (Material(400.0, 3.0), Material(3600.0, 20.0)),
}
"""Each environment before and after its step."""


@dataclass(slots=True)
class IdealAxis:
    """A position drive as a critically damped second-order lag; no bus, a little noise.

    Discretised exactly for a reference held over the period; the environment does not move it.
    """

    material: Material
    now_ns: Callable[[], int]
    rng: np.random.Generator
    position: float = 0.0
    velocity: float = 0.0
    reference: float = 0.0
    enabled: bool = False
    force_max: float = 0.0
    _decay: float = field(default=math.exp(-2 * math.pi * DRIVE_HZ * PERIOD_S), init=False)

    def configure(self) -> None:
        """Nothing to configure."""

    def arm(self) -> None:
        """Follow from here on."""
        self.enabled, self.reference = True, self.position

    def read_into(self, sample: Sample) -> None:
        """Advance one period and measure."""
        omega = 2 * math.pi * DRIVE_HZ
        error = self.position - self.reference
        rate = self.velocity + omega * error
        self.position = self.reference + (error + rate * PERIOD_S) * self._decay
        self.velocity = (self.velocity - omega * rate * PERIOD_S) * self._decay
        force = float(self.material.force(self.position - SURFACE_M, self.velocity))
        self.force_max = max(self.force_max, force)
        sample.stamp_ns = sample.position_stamp_ns = sample.force_stamp_ns = self.now_ns()
        sample.position = round(self.position / RESOLUTION_M) * RESOLUTION_M
        sample.force = force + FORCE_NOISE_N * float(self.rng.standard_normal())
        sample.valid, sample.enabled = True, self.enabled

    def write(self, position: float) -> None:
        """Take the reference of the next period."""
        self.reference = position

    def stop(self) -> None:
        """Stay."""
        self.enabled = False

    def close(self) -> None:
        """Nothing to release."""
