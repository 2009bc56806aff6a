"""A load cell at a slow converter: it averages, settles over several conversions, and jitters.

As HX711 at 80 samples a second: output settled after 50 ms, four conversions (data sheet of Avia
Semiconductor, table of key characteristics), its rate that of an RC oscillator. The filter is
taken as four moving averages of a conversion each.
"""

from __future__ import annotations

import random
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt_drivers.simulated.frame_devices import BOOT_NS, clamped
from teleop_rt_drivers.simulated.line_frames import INT24

if TYPE_CHECKING:
    from teleop_rt_drivers.simulated.byte_faults import FaultyFrames
    from teleop_rt_drivers.simulated.plant import Plant

NOMINAL_PERIOD_NS = 12_500_000
"""80 conversions a second, a load cell's usual rate."""
OSCILLATOR_ERROR = 0.008
"""Its rate is lower than 80 Hz by this share: 79.4 Hz."""
SETTLING_PERIODS = 4
"""Order of its sinc filter: a step is complete after so many conversions."""
SENDING_NS = (600_000, 1_400_000)
"""Time from the end of a conversion until its line has arrived, uniform between the two."""
FORCE_PER_COUNT = 2.0e-4
"""Rig unit of force of one count."""
TAPS = 32
"""Points of the filter in each conversion."""


def settling_weights() -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the filter's weights over its last conversions, oldest first; their sum is 1."""
    average = np.full(TAPS, 1.0 / TAPS)
    weights = average
    for _ in range(SETTLING_PERIODS - 1):
        weights = np.convolve(weights, average)
    return weights


class SlowConverter:
    """Sends its counts as a line of text after each conversion."""

    name = "force sensor"

    def __init__(self, plant: Plant, faults: FaultyFrames, seed: int) -> None:
        self.faults = faults
        self._plant = plant
        self._random = random.Random(seed)  # noqa: S311 - a reproducible disturbance
        self._period_ns = round(NOMINAL_PERIOD_NS * (1.0 + OSCILLATOR_ERROR))
        self._weights = settling_weights()
        ages = np.arange(len(self._weights))[::-1] * (self._period_ns / TAPS)
        self._ages_ns = ages.astype(np.int64)
        self._converted_ns = -1
        self._due_ns = 0

    def power_on(self) -> None:
        """Send the sketch's first lines; the first conversion was waited for."""
        self.faults.send(b"HX711\r\n")

    def receive(self, data: bytes, now_ns: int) -> None:
        """Ignore it: the device only sends."""

    def run(self, now_ns: int) -> bool:
        """Send the line that is due."""
        if self._converted_ns < 0:
            self._converted_ns = self._due_ns = now_ns
        if now_ns < self._due_ns:
            return False
        force = self._plant.averaged_force(self._converted_ns - self._ages_ns, self._weights)
        self.faults.send(b"%d\r\n" % clamped(force / FORCE_PER_COUNT, INT24))
        late = now_ns - self._converted_ns > 2 * self._period_ns
        self._convert_at((now_ns if late else self._converted_ns) + self._period_ns)
        return True

    def _convert_at(self, stamp_ns: int) -> None:
        self._converted_ns = stamp_ns
        self._due_ns = stamp_ns + self._random.randint(*SENDING_NS)

    def due_ns(self, now_ns: int) -> int:
        """Return when the next line is sent."""
        return self._due_ns if self._converted_ns >= 0 else now_ns

    def reset(self) -> None:
        """Start again: silent for a while."""
        self._convert_at(self._converted_ns + BOOT_NS)
        self.power_on()
