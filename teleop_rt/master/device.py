"""A real device in the operator's hand: position is measured, force is pushed into it."""

from __future__ import annotations

import math

from teleop_rt.axis import Device, Sample, Timing, sample_place
from teleop_rt.master.handle_faults import NO_FAULT, STALLED
from teleop_rt.master.handle_safety import HandleWatch
from teleop_rt.master.held_key import HeldKey

_VALID, _ENABLED, _POSITION = map(sample_place, ("valid", "enabled", "position"))


class HeldDevice:
    """An operator whose hand holds a device. The force felt is opposed to x, as the wall's is.

    Velocity is the difference of two samples behind a first-order low-pass of `cutoff_hz`, 0 for
    none, as the passivity bound assumes. A device with a fault detected by `watch` is stopped at
    once, and its position is kept. A `key` replaces its enabling switch.
    """

    def __init__(
        self,
        device: Device,
        watch: HandleWatch,
        period_s: float,
        cutoff_hz: float = 0.0,
        key: HeldKey | None = None,
    ) -> None:
        self._device = device
        self._key = key
        self.watch = watch
        self._period_s = period_s
        self._pole = math.exp(-2 * math.pi * cutoff_hz * period_s) if cutoff_hz > 0 else 0.0
        self._sample = Sample()
        self._position = 0.0
        self.reset()

    @property
    def powered(self) -> bool:
        """Whether the device pushes back: then it goes on with its last force in a stall."""
        return self._sample.counts[_ENABLED] > 0

    def give_up(self) -> None:
        """Stop the device for good: it was left on its last force for too long."""
        self.watch.let_go(STALLED)

    @property
    def timing(self) -> Timing:
        """Return how old samples are, and when a force acts, as the driver computes it."""
        return self._device.timing

    def configure(self) -> None:
        """Find the device and ask for its power. Raises AxisError."""
        self._device.configure()
        self._device.arm()

    def reset(self) -> None:
        """Forget the velocity; where the hand is, it stays."""
        self._known = False
        self._periods = 0
        self._velocity = 0.0

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:  # noqa: ARG002 - the hand has its own time, and feels by itself
        """Return the hand's position and velocity by the newest sample."""
        sample = self._sample
        self._device.read_into(sample)
        if self.watch.fault is not NO_FAULT:
            self._device.stop()
            return self._position, 0.0
        self._periods += 1
        if self._key is not None:
            sample.switch = self._key.update()
        if sample.counts[_VALID]:  # without a call for each number
            self._differentiate(sample.floats[_POSITION])
        self.watch.update(sample, self._velocity)
        if self.watch.fault is not NO_FAULT:
            self._device.stop()
            return self._position, 0.0
        return self._position, self._velocity

    def push(self, force: float) -> None:
        """Let the hand feel the force that answers the sample of this tick."""
        if self.watch.fault is NO_FAULT:
            self._device.push(-force)
            self.watch.commanded(-force)

    def _differentiate(self, position: float) -> None:
        """Take a sample over; after missing ones the difference spans as many periods."""
        if self._known:
            for _ in range(self._periods):
                step = (position - self._position) / (self._periods * self._period_s)
                self._velocity += (1 - self._pole) * (step - self._velocity)
        self._known, self._periods = True, 0
        self._position = position

    def close(self) -> None:
        """Stop the device and release it."""
        self._device.stop()
        self._device.close()
        if self._key is not None:
            self._key.close()
