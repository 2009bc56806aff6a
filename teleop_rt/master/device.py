"""A real device in the operator's hand: position is measured, force is pushed into it."""

from __future__ import annotations

from teleop_rt.axis import AxisFault, Device, Sample

SPAN = 4
"""Samples over which velocity is taken."""


class DeviceOperator:
    """An operator whose hand holds a device. The force felt is opposed to x, as the wall's is.

    A device with a fault, or one that was given up, is stopped, and stands where it was.
    """

    def __init__(self, device: Device, period_s: float) -> None:
        self._device = device
        self._span_s = SPAN * period_s
        self._positions = [0.0] * SPAN
        self._sample = Sample()
        self._position = 0.0
        self._given_up = False
        self.reset()

    @property
    def powered(self) -> bool:
        """Whether the device pushes back: then it goes on with its last force in a stall."""
        return self._sample.enabled

    def give_up(self) -> None:
        """Stop the device for good: it was left on its last force for too long."""
        self._given_up = True

    def configure(self) -> None:
        """Find the device and ask for its power. Raises AxisError."""
        self._device.configure()
        self._device.arm()

    def reset(self) -> None:
        """Forget the velocity; where the hand is, it stays."""
        self._at = -1
        self._velocity = 0.0

    def update(self, t_s: float, felt_force: float) -> tuple[float, float]:  # noqa: ARG002 - the hand has its own time
        """Return the hand's position and velocity, and let it feel a force."""
        sample = self._sample
        self._device.read_into(sample)
        if self._given_up or sample.fault is not AxisFault.NONE:
            self._device.stop()
            return self._position, 0.0
        if sample.valid:
            self._differentiate(sample.position)
            self._position = sample.position
        self._device.push(-felt_force)
        return self._position, self._velocity

    def _differentiate(self, position: float) -> None:
        if self._at < 0:
            self._at = 0
            self._positions[:] = [position] * SPAN
        self._velocity = (position - self._positions[self._at]) / self._span_s
        self._positions[self._at] = position
        self._at = (self._at + 1) % SPAN

    def close(self) -> None:
        """Stop the device and release it."""
        self._device.stop()
        self._device.close()
