"""The position loop of a drive in cyclic synchronous torque mode: closed here, not in the drive."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from teleop_rt_drivers.canopen.channel import Channel
    from teleop_rt_drivers.canopen.drive_config import TorqueConfig

SPAN = 4
"""Samples over which velocity is taken: one count is a quarter of the noise, at 2 ms of lag."""
STALE_CYCLES = 3
"""Cycles that the last force outlives its measurement; then there is none."""


class PositionLoop:
    """Force K (x_c - x) + D (v_c - v) [rig unit] from the newest measured position, limited."""

    def __init__(
        self, config: TorqueConfig, encoder: Channel, period_s: float, force_max: float
    ) -> None:
        self._config = config
        self._encoder = encoder
        self._force_max = force_max
        self._period_ns = round(period_s * 1e9)
        self._positions = [0.0] * SPAN
        self._commands = [0.0] * SPAN
        self._stamps = [0] * SPAN
        self.reset()

    def reset(self) -> None:
        """Begin at rest, wherever the tool is."""
        self._at = -1
        self._stamp_ns = 0
        self._stale = 0
        self._force = 0.0

    def update(self, command: float) -> float:
        """Return the force for a commanded position [rig unit]; to be called once a cycle."""
        position, stamp_ns = self._encoder.value, self._encoder.stamp_ns
        if self._at < 0:
            self._at = 0
            self._positions[:] = [position] * SPAN
            self._commands[:] = [command] * SPAN
            self._stamps[:] = [stamp_ns - (SPAN - age) * self._period_ns for age in range(SPAN)]
        elif stamp_ns == self._stamp_ns:
            self._stale += 1
            return self._force if self._stale <= STALE_CYCLES else 0.0
        self._stale = 0
        self._stamp_ns = stamp_ns
        at = self._at
        span_s = (stamp_ns - self._stamps[at]) * 1e-9  # longer than SPAN periods after a stall
        velocity = (position - self._positions[at]) / span_s
        wanted = (command - self._commands[at]) / span_s
        self._positions[at], self._commands[at] = position, command
        self._stamps[at] = stamp_ns
        self._at = (at + 1) % SPAN
        force = self._config.stiffness * (command - position)
        force += self._config.damping * (wanted - velocity)
        self._force = min(max(force, -self._force_max), self._force_max)
        return self._force
