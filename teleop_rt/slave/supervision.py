"""Measured supervision: two measurements of one quantity must agree while there is power.

Every comparison is written so that not-a-number stops the axis.
"""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import cast

from teleop_rt.axis import Sample, SampleFields
from teleop_rt.config.rig import Limits
from teleop_rt.config.supervision import SupervisionConfig, UnsafeWord
from teleop_rt.kernels.jit import kernel
from teleop_rt.slave import faults
from teleop_rt.slave.faults import FAULTS, Fault
from teleop_rt.slave.record import Tick, TickRecord

VELOCITY_MS = 10
"""Over so long the measured velocity is taken: quantisation is then below a hundredth of it."""
ALIGN_MS = 20
"""After power came on the drive's zero is aligned with the encoder's; then they are compared."""
FOLLOWING_SHARE, POSITION_SHARE, FORCE_SHARE, REPEATED_SHARE = 0.05, 0.05, 0.3, 0.01
"""Of the travel and of force_max: bounds that a healthy rig of any size keeps."""
REPEATED_STEPS = 10.0
"""Steps of its sensor by which a command moves before a position must be another number."""
SLOW_SHARE = 0.01
"""Of velocity_max: a slower motion may be noise, and dry friction of either sign."""
_DRIVE_SILENT, _OVERSPEED = faults.DRIVE_SILENT.code, faults.OVERSPEED.code
_FOLLOWING_ERROR, _REPEATED = faults.FOLLOWING_ERROR.code, faults.POSITION_REPEATED.code
_POSITION_MISMATCH, _FORCE_MISMATCH = faults.POSITION_MISMATCH.code, faults.FORCE_MISMATCH.code


@kernel
def take_in(t: Tick, s: SampleFields) -> None:
    """Take a sample over; a value that the drive should measure, and does not, is NaN."""
    t.usable = t.ready > 0 and s.valid > 0
    t.valid, t.enabled, t.missing = s.valid, s.enabled, s.missing
    t.axis_fault, t.sample_stamp_ns = s.fault, s.stamp_ns
    t.position, t.force = s.position, s.force
    t.position_stamp_ns, t.force_stamp_ns = s.position_stamp_ns, s.force_stamp_ns
    t.has_drive_position = t.needs_drive_position > 0 or s.has_drive_position > 0
    t.has_drive_force = t.needs_drive_force > 0 or s.has_drive_force > 0
    t.drive_position = s.drive_position if s.has_drive_position > 0 else math.nan
    t.drive_force = s.drive_force if s.has_drive_force > 0 else math.nan


@kernel
def unexplained(t: Tick, force: float, velocity: float) -> float:
    """Return a force on the guide less the friction at this velocity [rig unit].

    Coulomb and viscous friction between the drive and the force sensor.
    """
    rest = force - t.viscous * velocity
    if velocity > t.slow:
        return rest - t.coulomb
    if velocity < -t.slow:
        return rest + t.coulomb
    return rest - min(max(rest, -t.coulomb), t.coulomb)


@kernel
def measured_velocity(t: Tick, position: float) -> float:
    """Return the measured velocity over the window; 0 until it is full."""
    stamp_ns = t.position_stamp_ns
    before, before_ns = t.positions[t.window_place], t.stamps_ns[t.window_place]
    t.positions[t.window_place], t.stamps_ns[t.window_place] = position, stamp_ns
    t.window_place = (t.window_place + 1) % t.window
    if before_ns == 0 or stamp_ns <= before_ns:
        return 0.0
    return float((position - before) / (stamp_ns - before_ns) * 1e9)


@kernel
def unpowered(t: Tick) -> None:
    """Forget all, before power comes on."""
    t.supervised_ticks = t.far_ticks = t.silent = t.window_place = 0
    t.difference = t.mismatch = 0.0
    t.same_position = math.nan
    for i in range(t.window):
        t.stamps_ns[i] = 0


@kernel
def drive_mismatch(t: Tick, position: float, velocity: float) -> int:
    """Return the fault where drive, encoder and force sensor do not agree, 0 where they do.

    A quantity of the drive that its kind must give, and that is missing, is not a number.
    """
    if t.has_drive_position > 0:
        difference = position - t.drive_position
        if t.supervised_ticks <= t.align_ticks:
            t.difference = difference
        if not abs(difference - t.difference) <= t.difference_max:
            return _POSITION_MISMATCH
    if t.has_drive_force > 0:
        guide = t.drive_force - t.load - t.force
        t.mismatch += t.mismatch_gain * (unexplained(t, guide, velocity) - t.mismatch)
        if not abs(t.mismatch) <= t.mismatch_max:
            return _FORCE_MISMATCH
    return 0


@kernel
def repeats(t: Tick, position: float, command: float) -> bool:
    """Return whether the position is one number for too long while the command has moved on.

    A drive that stands under its own motor's force, or a living sensor with noise, gives another
    number long before: one that is exactly the same is an old answer, or a jammed tool. Until
    then the tool is no further from where it is said to be than the command moved. A first command
    that is not a number yet is no place to count from; if it stays so, the axis does not follow it.
    """
    if position != t.same_position or math.isnan(t.same_command):
        t.same_position, t.same_command = position, command
    stamp_ns = t.position_stamp_ns
    if abs(command - t.same_command) <= t.same_max:
        t.same_far, t.same_from_ns = 0, stamp_ns
    elif t.same_far == 0 and stamp_ns > t.same_from_ns:  # measured since the command has left
        t.same_far, t.same_from_ns = 1, stamp_ns
    return t.same_far > 0 and (stamp_ns - t.same_from_ns) * 1e-6 > t.same_ms


@kernel
def disagreement(t: Tick, position: float, command: float, follows: bool) -> int:
    """Return the fault for which the axis must stop, 0 where all agree: see `Supervision.check`."""
    if t.enabled == 0:
        t.silent += 1
        return _DRIVE_SILENT if t.silent > (t.silent_ticks if follows else t.enable_ticks) else 0
    t.silent = 0
    t.supervised_ticks += 1
    velocity = measured_velocity(t, position)
    if not abs(velocity) <= t.overspeed:
        return _OVERSPEED
    close = abs(command - position) <= t.following_max
    t.far_ticks = 0 if close else t.far_ticks + 1
    if t.far_ticks > t.following_ticks:
        return _FOLLOWING_ERROR
    if repeats(t, position, command):
        return _REPEATED
    return drive_mismatch(t, position, velocity)


class Supervision:
    """Compares command, encoder, force sensor and drive, tick by tick; allocates nothing.

    `lacks` names the comparisons that the drive does not allow; any other quantity of the drive
    that is missing counts as not a number. `resolution` is a step of the measured position.
    """

    def __init__(
        self,
        config: SupervisionConfig,
        limits: Limits,
        rate_hz: int,
        lacks: Collection[UnsafeWord] = (),
        record: TickRecord | None = None,
        resolution: float = 0.0,
    ) -> None:
        self._record = record or TickRecord()
        travel = limits.position_max - limits.position_min
        ticks_per_ms = rate_hz * 1e-3
        tick = self._record.tick
        tick.needs_drive_position = "position_comparison" not in lacks
        tick.needs_drive_force = "force_comparison" not in lacks
        tick.following_max = config.following_error_max or FOLLOWING_SHARE * travel
        tick.following_ticks = config.following_error_ms * ticks_per_ms
        least = max(REPEATED_SHARE * travel, REPEATED_STEPS * resolution)
        tick.same_max = config.repeated_position_max or least
        tick.same_ms = config.repeated_position_ms
        tick.overspeed = config.velocity_share_max * limits.velocity_max
        tick.difference_max = config.position_difference_max or POSITION_SHARE * travel
        tick.mismatch_max = config.force_difference_max or FORCE_SHARE * limits.force_max
        tick.mismatch_gain = 1.0 / max(1.0, config.force_difference_ms * ticks_per_ms)
        tick.load, tick.slow = config.load, SLOW_SHARE * limits.velocity_max
        tick.coulomb, tick.viscous = config.coulomb_friction, config.viscous_friction
        tick.silent_ticks = config.drive_silent_ms * ticks_per_ms
        tick.enable_ticks = config.drive_enable_ms * ticks_per_ms
        tick.align_ticks = ALIGN_MS * ticks_per_ms
        tick.window = max(2, round(VELOCITY_MS * ticks_per_ms))
        self.reset()

    def reset(self) -> None:
        """Reset, before power comes on."""
        unpowered(self._record.tick)

    def check(
        self, sample: Sample, position: float, command: float, *, follows: bool
    ) -> Fault | None:
        """Return why the axis must stop, None where all agree.

        `position` is measured and `command` was sent, both in the encoder's own coordinates. An
        axis that does not follow yet may be without power for as long as enabling may take.
        """
        tick = self._record.tick
        take_in(tick, cast("SampleFields", sample.stored[0]))
        code = disagreement(tick, position, command, follows)
        return FAULTS[code] if code else None
