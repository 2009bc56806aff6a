"""A device's clock on ours: a recursive straight line through (device time, arrival), outliers out.

Arrival is the device's time plus a delay that varies; the line follows the drift between the two
clocks and averages the variation. After Klipper's `clocksync.py`, in the form of recursive least
squares with forgetting (Ljung, 1999, section 11.2).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel

FORGETTING = 0.999
"""Per sample of offset and rate: a memory of 1000 samples."""
GATE_SIGMA = 5.0
"""Deviations from the prediction beyond which a stamp is an outlier."""
FLOOR_NS = 20_000.0
"""Arrivals vary by at least so much; below, the gate would shut on quantisation."""
WARM_UP = 50
"""Samples before the gate applies: until then the deviation is not known."""
MOST_OUTLIERS_IN_A_ROW = 50
"""Of so many together the model is wrong, not the stamps: it begins again."""
_WORD_BITS, _ALL_BITS = 64, -1  # of an int64, in which counts are compared
START_COVARIANCE = 1e12
"""Variance of the offset at the start [ns^2]: a millisecond."""
RATE_COVARIANCE = 1e-6
"""The device's second is ours within 0.1 % at the start."""


_STATE = np.dtype(
    [(name, np.int64) for name in ("samples", "origin_ns", "outliers", "in_a_row", "count", "mask")]
    + [(name, np.float64) for name in ("offset_ns", "rate", "p00", "p01", "p11", "variance")]
    + [("tick_ns", np.float64)]
)
Stored = NDArray[np.record]


def new_clocks(count: int) -> Stored:
    """Return zeroed clocks (n,)."""
    return np.zeros(count, np.dtype((np.record, _STATE)))


@kernel
def forget(clock: Any) -> None:
    """Forget both clocks."""
    clock.samples = clock.origin_ns = clock.in_a_row = 0
    clock.offset_ns, clock.rate, clock.variance = 0.0, 1.0, 0.0
    clock.p00, clock.p01, clock.p11 = START_COVARIANCE, 0.0, RATE_COVARIANCE


@kernel
def take_count(clock: Any, count: int, arrival_ns: int) -> int:
    """Take a count, as `DeviceClock.word` has it, and its arrival; return its time on our clock."""
    if clock.samples == 0:
        clock.count = count
    # Between counts of 64 bits as well: their difference wraps around as they do.
    step_ns = float(np.uint64(count - clock.count) & np.uint64(clock.mask)) * clock.tick_ns
    clock.count = count
    return advance(clock, step_ns, arrival_ns)


@kernel
def take_into(stored: Stored, count: int, arrival_ns: int) -> int:
    """Take a count into the clock in an array of one: see `take_count`."""
    return take_count(stored[0], count, arrival_ns)


@kernel
def advance(clock: Any, step_ns: float, arrival_ns: int) -> int:
    """Take a count that came so long after the one before; return its time on our clock."""
    if clock.samples == 0:
        clock.origin_ns = arrival_ns
    # The state belongs to the newest device time, so that the numbers stay small for ever.
    clock.offset_ns += clock.rate * step_ns
    clock.p00 += step_ns * (2.0 * clock.p01 + step_ns * clock.p11)
    clock.p01 += step_ns * clock.p11
    correct(clock, float(arrival_ns - clock.origin_ns) - clock.offset_ns)
    return int(clock.origin_ns + np.int64(np.rint(clock.offset_ns)))


@kernel
def correct(clock: Any, error: float) -> None:
    """Move the line by this arrival, unless it is an outlier."""
    gate = GATE_SIGMA * max(math.sqrt(clock.variance), FLOOR_NS)
    if clock.samples >= WARM_UP and abs(error) > gate:
        clock.outliers += 1
        clock.in_a_row += 1
        if clock.in_a_row >= MOST_OUTLIERS_IN_A_ROW:
            forget(clock)
        return
    clock.in_a_row = 0
    clock.samples += 1
    innovation = FORGETTING * (FLOOR_NS * FLOOR_NS) + clock.p00
    gain, rate_gain = clock.p00 / innovation, clock.p01 / innovation
    clock.offset_ns += gain * error
    clock.rate += rate_gain * error
    clock.p11 = (clock.p11 - rate_gain * clock.p01) / FORGETTING
    clock.p01 = (1.0 - gain) * clock.p01 / FORGETTING
    clock.p00 = (1.0 - gain) * clock.p00 / FORGETTING
    share = max(1.0 - FORGETTING, 1.0 / clock.samples)
    clock.variance += share * (error * error - clock.variance)


class DeviceClock:
    """Maps a device's counter of `bits` and `tick_s` per count onto monotonic nanoseconds."""

    def __init__(self, tick_s: float, bits: int, stored: Stored | None = None) -> None:
        """Begin with neither clock known; `stored` is room (1,) for the kernels' state."""
        self._modulo = 1 << bits
        self._half = 1 << bits - 1
        self.stored = new_clocks(1) if stored is None else stored
        self._clock: Any = self.stored[0]
        self._clock.tick_ns = tick_s * 1e9
        self._clock.mask = _ALL_BITS if bits == _WORD_BITS else self._modulo - 1
        words = self.stored.view(np.uint8).data.cast("q")
        self._samples, self._outliers = words[:1], words[2:3]
        take_into(self.stored, 0, 0)  # compiled and loaded now, not in a tick
        self.reset()

    def reset(self) -> None:
        """Forget both clocks."""
        forget(self._clock)

    def word(self, count: int) -> int:
        """Return a count, whatever its field holds beside it, as a word that kernels take."""
        return (count + self._half) % self._modulo - self._half

    @property
    def samples(self) -> int:
        """How many arrivals the line is made of."""
        return self._samples[0]

    @property
    def outliers(self) -> int:
        """How many arrivals were left out."""
        return self._outliers[0]

    @property
    def drift_ppm(self) -> float:
        """Drift of our clock against the device's [ppm], positive if ours is faster."""
        return float(self._clock.rate - 1.0) * 1e6

    @property
    def deviation_ns(self) -> float:
        """Standard deviation of the arrivals about the line."""
        return math.sqrt(self._clock.variance)

    def update(self, count: int, arrival_ns: int) -> int:
        """Take a count and its arrival; return the count's time on our clock."""
        return take_into(self.stored, self.word(count), arrival_ns)
