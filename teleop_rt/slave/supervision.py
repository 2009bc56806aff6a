"""Measured supervision: what two devices measure of one thing must agree while there is power.

Every comparison is written so that not-a-number stops the axis.
"""

from __future__ import annotations

import math
from collections.abc import Collection

from teleop_rt.axis import Sample
from teleop_rt.config_rig import Limits
from teleop_rt.config_supervision import SupervisionConfig, UnsafeWord
from teleop_rt.slave import faults
from teleop_rt.slave.faults import Fault

VELOCITY_MS = 10
"""Over so long the measured velocity is taken: quantisation is then below a hundredth of it."""
ALIGN_MS = 20
"""After power came on the drive's zero is aligned with the encoder's; then they are compared."""
FOLLOWING_SHARE, POSITION_SHARE, FORCE_SHARE = 0.05, 0.05, 0.3
"""Of the travel and of force_max: what a healthy rig of any size stays within."""


SLOW_SHARE = 0.01
"""Of velocity_max: a slower motion may be noise, and dry friction of either sign."""


class Friction:
    """Coulomb and viscous friction between the drive and the force sensor."""

    def __init__(self, config: SupervisionConfig, velocity_max: float) -> None:
        self._coulomb, self._viscous = config.coulomb_friction, config.viscous_friction
        self._slow = SLOW_SHARE * velocity_max

    def unexplained(self, force: float, velocity: float) -> float:
        """Return what friction at this velocity leaves of a force on the guide [rig unit]."""
        rest = force - self._viscous * velocity
        if velocity > self._slow:
            return rest - self._coulomb
        if velocity < -self._slow:
            return rest + self._coulomb
        return rest - min(max(rest, -self._coulomb), self._coulomb)


class Supervision:
    """Compares command, encoder, force sensor and drive, tick by tick; allocates nothing.

    `lacks` names the comparisons that the drive does not allow; any other quantity of the drive
    that is missing counts as not a number.
    """

    def __init__(
        self,
        config: SupervisionConfig,
        limits: Limits,
        rate_hz: int,
        lacks: Collection[UnsafeWord] = (),
    ) -> None:
        self._has_position = "position_comparison" not in lacks
        self._has_force = "force_comparison" not in lacks
        travel = limits.position_max - limits.position_min
        ticks_per_ms = rate_hz * 1e-3
        self._following_max = config.following_error_max or FOLLOWING_SHARE * travel
        self._following_ticks = config.following_error_ms * ticks_per_ms
        self._velocity_max = config.velocity_share_max * limits.velocity_max
        self._position_max = config.position_difference_max or POSITION_SHARE * travel
        self._force_max = config.force_difference_max or FORCE_SHARE * limits.force_max
        self._force_gain = 1.0 / max(1.0, config.force_difference_ms * ticks_per_ms)
        self._load = config.load
        self._friction = Friction(config, limits.velocity_max)
        self._silent_ticks = config.drive_silent_ms * ticks_per_ms
        self._align_ticks = ALIGN_MS * ticks_per_ms
        window = max(2, round(VELOCITY_MS * ticks_per_ms))
        self._positions = [0.0] * window
        self._stamps_ns = [0] * window
        self.reset()

    def reset(self) -> None:
        """Reset, before power comes on."""
        self._powered = self._behind = self._silent = self._place = 0
        self._difference = self._force = 0.0
        for index in range(len(self._stamps_ns)):
            self._stamps_ns[index] = 0

    def check(
        self, sample: Sample, position: float, command: float, *, follows: bool
    ) -> Fault | None:
        """Return why the axis must stop, None where all agree.

        `position` is measured and `command` was sent, both in the encoder's own coordinates. An
        axis that does not follow yet may be without power.
        """
        if not sample.enabled:
            self._silent += follows
            return faults.DRIVE_SILENT if self._silent > self._silent_ticks else None
        self._silent = 0
        self._powered += 1
        velocity = self._velocity(sample, position)
        if not abs(velocity) <= self._velocity_max:
            return faults.OVERSPEED
        close = abs(command - position) <= self._following_max
        self._behind = 0 if close else self._behind + 1
        if self._behind > self._following_ticks:
            return faults.FOLLOWING_ERROR
        return self._compare_drive(sample, position, velocity)

    def _compare_drive(self, sample: Sample, position: float, velocity: float) -> Fault | None:
        drive_position, drive_force = sample.drive_position, sample.drive_force
        if drive_position is None and self._has_position:
            drive_position = math.nan
        if drive_force is None and self._has_force:
            drive_force = math.nan
        if drive_position is not None:
            difference = position - drive_position
            if self._powered <= self._align_ticks:
                self._difference = difference
            if not abs(difference - self._difference) <= self._position_max:
                return faults.POSITION_MISMATCH
        if drive_force is not None:
            guide = drive_force - self._load - sample.force
            difference = self._friction.unexplained(guide, velocity)
            self._force += self._force_gain * (difference - self._force)
            if not abs(self._force) <= self._force_max:
                return faults.FORCE_MISMATCH
        return None

    def _velocity(self, sample: Sample, position: float) -> float:
        """Return the measured velocity over the window; 0 until it is full."""
        place, stamp_ns = self._place, sample.position_stamp_ns
        before, before_ns = self._positions[place], self._stamps_ns[place]
        self._positions[place], self._stamps_ns[place] = position, stamp_ns
        self._place = (place + 1) % len(self._positions)
        if before_ns == 0 or stamp_ns <= before_ns:
            return 0.0
        return (position - before) / (stamp_ns - before_ns) * 1e9
