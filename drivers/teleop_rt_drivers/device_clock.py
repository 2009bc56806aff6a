"""A device's clock on ours: a recursive straight line through (device time, arrival), outliers out.

Arrival is the device's time plus a delay that varies; the line follows the drift between the two
clocks and averages the variation. After Klipper's `clocksync.py`, in the form of recursive least
squares with forgetting (Ljung, 1999, section 11.2).
"""

from __future__ import annotations

import math

FORGETTING = 0.999
GATE_SIGMA = 5.0
FLOOR_NS = 20_000.0
"""Arrivals vary by at least so much; below, the gate would shut on quantisation."""
WARM_UP = 50
MOST_OUTLIERS_IN_A_ROW = 50
START_COVARIANCE = 1e12
RATE_COVARIANCE = 1e-6
"""The device's second is ours within 0.1 % at the start."""


class DeviceClock:
    """Maps a device's counter of `bits` and `tick_s` per count onto monotonic nanoseconds."""

    def __init__(self, tick_s: float, bits: int) -> None:
        self._tick_ns = tick_s * 1e9
        self._modulo = 1 << bits
        self.outliers = 0
        self.reset()

    def reset(self) -> None:
        """Forget both clocks."""
        self.samples = 0
        self.count = 0
        self._origin_ns = 0
        self._offset_ns = 0.0
        self._rate = 1.0
        self._p00, self._p01, self._p11 = START_COVARIANCE, 0.0, RATE_COVARIANCE
        self._variance = 0.0
        self._in_a_row = 0

    @property
    def drift_ppm(self) -> float:
        """Drift of our clock against the device's [ppm], positive if ours is faster."""
        return (self._rate - 1.0) * 1e6

    @property
    def deviation_ns(self) -> float:
        """Standard deviation of the arrivals about the line."""
        return math.sqrt(self._variance)

    def update(self, count: int, arrival_ns: int) -> int:
        """Take a count and its arrival; return the count's time on our clock."""
        if self.samples == 0:
            self._origin_ns = arrival_ns
            self.count = count
        step_ns = ((count - self.count) % self._modulo) * self._tick_ns
        self.count = count
        # The state belongs to the newest device time, so that the numbers stay small for ever.
        self._offset_ns += self._rate * step_ns
        self._p00 += step_ns * (2.0 * self._p01 + step_ns * self._p11)
        self._p01 += step_ns * self._p11
        self._correct(arrival_ns - self._origin_ns)
        return self._origin_ns + round(self._offset_ns)

    def _correct(self, arrival_ns: int) -> None:
        """Move the line by what this arrival says, unless it is an outlier."""
        error = arrival_ns - self._offset_ns
        gate = GATE_SIGMA * max(self.deviation_ns, FLOOR_NS)
        if self.samples >= WARM_UP and abs(error) > gate:
            self.outliers += 1
            self._in_a_row += 1
            if self._in_a_row >= MOST_OUTLIERS_IN_A_ROW:
                self.reset()
            return
        self._in_a_row = 0
        self.samples += 1
        noise = FLOOR_NS**2
        innovation = FORGETTING * noise + self._p00
        gain, rate_gain = self._p00 / innovation, self._p01 / innovation
        self._offset_ns += gain * error
        self._rate += rate_gain * error
        self._p11 = (self._p11 - rate_gain * self._p01) / FORGETTING
        self._p01 = (1.0 - gain) * self._p01 / FORGETTING
        self._p00 = (1.0 - gain) * self._p00 / FORGETTING
        share = max(1.0 - FORGETTING, 1.0 / self.samples)
        self._variance += share * (error * error - self._variance)
