"""A measured value, or a switch, out of frames; values are checked and stamped."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, cast

import numpy as np

from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.device_clock import DeviceClock
from teleop_rt_drivers.framed import taking

if TYPE_CHECKING:
    from teleop_rt_drivers.framed.signal_config import SignalConfig, SwitchSignal
    from teleop_rt_drivers.framed.source import Source, Values
    from teleop_rt_drivers.quantity import Plausible, Scale

_VALUE, _STAMP = taking.place("value"), taking.place("stamp_ns")
_DEVICE_STAMP, _KNOWN = taking.place("device_stamp_ns"), taking.place("known")


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


class MeasuredSignal:
    """One value of the rig, from the newest frame that passed every check.

    `value` [rig unit] and `stamp_ns` change only where a cycle is settled: by `settle`, or by
    `taking.settle_cycle` on the `stored` value. `device_stamp_ns` is the device's own time of the
    value on our clock, -1 without a clock.
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
        self.source = source
        self._slot = source.slot(config.field)
        self._counters = counters
        self._status_slot = -1 if config.status is None else source.slot(config.status.field)
        self._good = 0 if config.status is None else config.status.good
        stored, clock = source.listen_for_value(self._take)
        self._clock, self._clock_slot = None, taking.NOWHERE
        if config.clock is not None:
            self._clock = DeviceClock(config.clock.tick_s, config.clock.bits, clock)
            self._clock_slot = source.slot(config.clock.field)
        self._store(stored, scale, plausible)
        self._state.held_ns = round(1e6 * held_ms)
        self._state.timeout_ns = config.timeout_ms * 1_000_000
        self._state.clock_bits = 1 if config.clock is None else config.clock.bits
        self._accept = bound(taking.take, (stored, clock), 0.0, True, 0, 0)  # noqa: FBT003
        self._settle = bound(taking.settle, (stored,), 0)

    def _store(self, stored: taking.StoredValue, scale: Scale, plausible: Plausible) -> None:
        """Write the value's settings for kernels, and keep views of them."""
        self.stored = stored
        self._state = state = cast("taking.Value", stored[0])
        state.offset, state.gain = scale.offset, scale.sign * scale.per_count
        state.lower, state.upper = plausible.lower, plausible.upper
        state.rate, state.slack = plausible.rate, plausible.slack
        state.has_clock = self._clock is not None
        state.candidate, state.candidate_device_ns, state.device_stamp_ns = math.nan, -1, -1
        state.slot, state.clock_slot = self._slot, self._clock_slot
        state.status_slot, state.good = self._status_slot, self._good
        words = stored.view(np.uint8).data
        self._floats, self._counts = words.cast("d"), words.cast("q")

    @property
    def value(self) -> float:
        """The value that was taken over last [rig unit]."""
        return self._floats[_VALUE]

    @property
    def stamp_ns(self) -> int:
        """When its frame came, or when the watch began."""
        return self._counts[_STAMP]

    @property
    def device_stamp_ns(self) -> int:
        """The device's own time of the value."""
        return self._counts[_DEVICE_STAMP]

    @property
    def known(self) -> bool:
        """Whether a value was taken over since the last reset."""
        return self._counts[_KNOWN] > 0

    def reset(self, now_ns: int) -> None:
        """Forget the value: the next one may be anywhere in range."""
        self._state.watched_ns = self._state.stamp_ns = now_ns
        self._state.known, self._state.candidate = 0, math.nan

    def begin(self, now_ns: int) -> None:
        """Begin to watch: the source has its whole timeout from now, and its clock is new.

        Values that waited before the loop began have no known sending time.
        """
        self._state.watched_ns = now_ns
        if self._clock is not None:
            self._clock.reset()

    def _take(self, values: Values, now_ns: int) -> None:
        """Keep a frame's value if it can be true."""
        raw, slot, clock = values[self._slot], self._status_slot, self._clock
        good, count = slot < 0 or values[slot] == self._good, 0
        if clock is not None:
            time = values[self._clock_slot]
            if math.isfinite(time):
                count = clock.word(int(time))
            else:
                raw = math.nan
        if code := self._accept(raw, good, count, now_ns):
            self._counters[taking.COUNTERS[code]] += 1

    def settle(self, now_ns: int) -> bool:
        """Take over this cycle's value if it did not jump; return whether it is new."""
        found = self._settle(now_ns)
        self.note(found)
        return found & taking.NEW > 0

    def note(self, found: int) -> None:
        """Count the finding on the value of a cycle."""
        if found & taking.JUMPED:
            self._counters["impossible_jump"] += 1
