"""A measured value, or a switch, out of frames; values are checked and stamped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt_drivers.device_clock import DeviceClock

if TYPE_CHECKING:
    from teleop_rt_drivers.framed.signal_config import SignalConfig, SwitchSignal
    from teleop_rt_drivers.framed.source import Source, Values
    from teleop_rt_drivers.quantity import Plausible, Scale


class Switch:
    """A home switch: `closed` as the newest good frame of its source says; open by no number."""

    def __init__(self, config: SwitchSignal, source: Source) -> None:
        self.closed = False
        self._slot = source.slot(config.field)
        self._mask = config.mask
        self._inverted = config.inverted
        source.listen(self._take)

    def _take(self, values: Values, _: int) -> None:
        bits = values[self._slot]
        self.closed = math.isfinite(bits) and bool(int(bits) & self._mask) != self._inverted


class Signal:
    """One value of the rig, from the newest frame that passed every check.

    `value` [rig unit] and `stamp_ns` change only in `settle`. `device_stamp_ns` is the device's
    own time of the value on our clock, -1 without a clock.
    """

    def __init__(
        self,
        name: str,
        config: SignalConfig,
        source: Source,
        scale: Scale,
        plausible: Plausible,
        counters: dict[str, int],
        held_ms: float = 0.0,
    ) -> None:
        self.name = name
        self.lost = f"{name}: silent for more than {config.timeout_ms} ms"
        self.too_old = f"{name}: older than {held_ms:g} ms" if held_ms else f"{name}: no new value"
        self.value = 0.0
        self.stamp_ns = 0
        self.device_stamp_ns = -1
        self.known = False
        self.source = source
        self._held_ns = round(1e6 * held_ms)
        self._new = False
        self._timeout_ns = config.timeout_ms * 1_000_000
        self._slot = source.slot(config.field)
        self._offset, self._gain = scale.offset, scale.sign * scale.per_count
        self._plausible = plausible
        self._counters = counters
        self._status_slot = -1 if config.status is None else source.slot(config.status.field)
        self._good = 0 if config.status is None else config.status.good
        self._clock = None
        self._clock_slot = -1
        if config.clock is not None:
            self._clock = DeviceClock(config.clock.tick_s, config.clock.bits)
            self._clock_slot = source.slot(config.clock.field)
        self._watched_ns = 0
        self._candidate = math.nan
        self._candidate_ns = 0
        self._candidate_device_ns = -1
        source.listen(self._take)

    def reset(self, now_ns: int) -> None:
        """Forget the value: the next one may be anywhere in range."""
        self.known = False
        self.stamp_ns = self._watched_ns = now_ns
        self._candidate = math.nan

    def begin(self, now_ns: int) -> None:
        """Begin to watch: the source has its whole timeout from now, and its clock is new.

        Values that waited before the loop began have no known sending time.
        """
        self._watched_ns = now_ns
        if self._clock is not None:
            self._clock.reset()

    def silent(self, now_ns: int) -> bool:
        """Return whether no good value has come for longer than the timeout."""
        return now_ns - max(self.stamp_ns, self._watched_ns) > self._timeout_ns

    def usable(self, now_ns: int) -> bool:
        """Return whether the value is new since the last cycle, or not older than its hold time."""
        return self._new or (self.known and now_ns - self.stamp_ns <= self._held_ns)

    def _take(self, values: Values, now_ns: int) -> None:
        """Keep a frame's value if it can be true."""
        value = self._offset + self._gain * values[self._slot]
        if self._status_slot >= 0 and values[self._status_slot] != self._good:
            self._counters["bad_status"] += 1
        elif not (math.isfinite(value) and math.isfinite(self._device_time(values))):
            self._counters["not_a_number"] += 1
        elif not self._plausible.lower <= value <= self._plausible.upper:
            self._counters["out_of_range"] += 1
        elif self._clock is not None and not self._ticked(self._clock, values, now_ns):
            self._counters["repeated"] += 1
        else:
            self._candidate = value
            self._candidate_ns = now_ns

    def _device_time(self, values: Values) -> float:
        """Return the count of the device's own clock, 0 without one."""
        return values[self._clock_slot] if self._clock is not None else 0.0

    def _ticked(self, clock: DeviceClock, values: Values, now_ns: int) -> bool:
        """Map the device's time on ours; false where its clock stands still: a frozen device."""
        count, outliers = int(values[self._clock_slot]), clock.outliers
        if clock.samples and count == clock.count:
            return False
        self._candidate_device_ns = clock.update(count, now_ns)
        self._counters["clock_outliers"] += clock.outliers - outliers
        return True

    def settle(self) -> bool:
        """Take over what this cycle brought if it did not jump; return whether it is new."""
        self._new = self._taken_over()
        return self._new

    def _taken_over(self) -> bool:
        candidate, self._candidate = self._candidate, math.nan
        if math.isnan(candidate):
            return False
        plausible = self._plausible
        elapsed_s = (self._candidate_ns - self.stamp_ns) * 1e-9
        reach = plausible.slack + plausible.rate * elapsed_s
        if self.known and abs(candidate - self.value) > reach:
            self._counters["impossible_jump"] += 1
            return False
        self.value = candidate
        self.stamp_ns = self._candidate_ns
        self.device_stamp_ns = self._candidate_device_ns
        self.known = True
        return True
