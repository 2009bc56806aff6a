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
def take_in(tick: Tick, sample: SampleFields) -> None:
    """Take a sample over; a value that the drive should measure, and does not, is NaN.

    Cycles without a valid sample are counted here, too: a driver may not count them.
    """
    numbers = math.isfinite(sample.position) and math.isfinite(sample.force)
    tick.usable = tick.ready > 0 and sample.valid > 0 and numbers
    tick.valid, tick.enabled = sample.valid, sample.enabled
    tick.invalid_in_a_row = 0 if sample.valid > 0 else tick.invalid_in_a_row + 1
    tick.missing = max(sample.missing, tick.invalid_in_a_row)
    tick.axis_fault, tick.sample_stamp_ns = sample.fault, sample.stamp_ns
    tick.position, tick.force = sample.position, sample.force
    tick.position_stamp_ns, tick.force_stamp_ns = sample.position_stamp_ns, sample.force_stamp_ns
    tick.has_drive_position = tick.needs_drive_position > 0 or sample.has_drive_position > 0
    tick.has_drive_force = tick.needs_drive_force > 0 or sample.has_drive_force > 0
    tick.drive_position = sample.drive_position if sample.has_drive_position > 0 else math.nan
    tick.drive_force = sample.drive_force if sample.has_drive_force > 0 else math.nan


@kernel
def beyond_friction(tick: Tick, force: float, velocity: float) -> float:
    """Return a force on the guide less the friction at this velocity [rig unit].

    Coulomb and viscous friction between the drive and the force sensor.
    """
    rest = force - tick.viscous * velocity
    if velocity > tick.slow:
        return rest - tick.coulomb
    if velocity < -tick.slow:
        return rest + tick.coulomb
    return rest - min(max(rest, -tick.coulomb), tick.coulomb)


@kernel
def measured_velocity(tick: Tick, position: float) -> float:
    """Return the measured velocity over the window; 0 until it is full."""
    stamp_ns = tick.position_stamp_ns
    before, before_ns = tick.positions[tick.window_place], tick.stamps_ns[tick.window_place]
    tick.positions[tick.window_place], tick.stamps_ns[tick.window_place] = position, stamp_ns
    tick.window_place = (tick.window_place + 1) % tick.window
    if before_ns == 0 or stamp_ns <= before_ns:
        return 0.0
    return float((position - before) / (stamp_ns - before_ns) * 1e9)


@kernel
def unpowered(tick: Tick) -> None:
    """Forget all, before power comes on."""
    tick.supervised_ticks = tick.far_ticks = tick.silent = tick.window_place = 0
    tick.difference = tick.mismatch = 0.0
    tick.same_position = math.nan
    for i in range(tick.window):
        tick.stamps_ns[i] = 0


@kernel
def drive_mismatch(tick: Tick, position: float, velocity: float) -> int:
    """Return the fault where drive, encoder and force sensor do not agree, 0 where they do.

    A quantity of the drive that its kind must give, and that is missing, is not a number.
    """
    if tick.has_drive_position > 0:
        difference = position - tick.drive_position
        if tick.supervised_ticks <= tick.align_ticks:
            tick.difference = difference
        if not abs(difference - tick.difference) <= tick.difference_max:
            return _POSITION_MISMATCH
    if tick.has_drive_force > 0:
        guide = tick.drive_force - tick.load - tick.force
        tick.mismatch += tick.mismatch_gain * (
            beyond_friction(tick, guide, velocity) - tick.mismatch
        )
        if not abs(tick.mismatch) <= tick.mismatch_max:
            return _FORCE_MISMATCH
    return 0


@kernel
def repeats(tick: Tick, position: float, command: float) -> bool:
    """Return whether the position is one number for too long while the command has moved on.

    A drive that stands under its own motor's force, or a living sensor with noise, gives another
    number long before: one that is exactly the same is an old answer, or a jammed tool. Until
    then the tool is no further from where it is said to be than the command moved. A first command
    that is not a number yet is no place to count from; if it stays so, the axis does not follow it.
    """
    if position != tick.same_position or math.isnan(tick.same_command):
        tick.same_position, tick.same_command = position, command
    stamp_ns = tick.position_stamp_ns
    if abs(command - tick.same_command) <= tick.same_max:
        tick.same_far, tick.same_from_ns = 0, stamp_ns
    elif tick.same_far == 0 and stamp_ns > tick.same_from_ns:  # measured since the command has left
        tick.same_far, tick.same_from_ns = 1, stamp_ns
    return tick.same_far > 0 and (stamp_ns - tick.same_from_ns) * 1e-6 > tick.same_ms


@kernel
def disagreement(tick: Tick, position: float, command: float, follows: bool) -> int:
    """Return the fault for which the axis must stop, 0 where all agree: see `Supervision.check`."""
    if tick.enabled == 0:
        tick.silent += 1
        most = tick.silent_ticks if follows else tick.enable_ticks
        return _DRIVE_SILENT if tick.silent > most else 0
    tick.silent = 0
    tick.supervised_ticks += 1
    velocity = measured_velocity(tick, position)
    if not abs(velocity) <= tick.overspeed:
        return _OVERSPEED
    close = abs(command - position) <= tick.following_max
    tick.far_ticks = 0 if close else tick.far_ticks + 1
    if tick.far_ticks > tick.following_ticks:
        return _FOLLOWING_ERROR
    if repeats(tick, position, command):
        return _REPEATED
    return drive_mismatch(tick, position, velocity)


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
