"""The safety chain of the operator's device, which takes its force away within 20 ms.

Each hazard is judged on the device's own report, every cycle, and the first one is latched: a
device that was let go pushes no more until the master restarts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.axis import NO_AXIS_FAULT, Sample, sample_place
from teleop_rt.config.device import EnablingSwitch
from teleop_rt.config.rig import Limits
from teleop_rt.config.supervision import UnsafeWord
from teleop_rt.kernels.jit import bound, kernel
from teleop_rt.kernels.record import record_type
from teleop_rt.master import handle_faults as faults

STALE_S = 0.010
"""Age of the newest valid sample at which its force is no answer any more."""
ENABLING_S = 2.0
"""A drive takes less to follow; until it does, no force is felt and nothing is wrong."""
FORCE_OFF_S = 0.005
"""How long a force may lie outside the recent commands: a settling current takes less."""
FORCE_WINDOW_S = 0.010
"""Window of recent commands: longer than any bus and drive take to answer."""
FORCE_SHARE = 0.1
"""Of force_max: by how much a motor's force may be off; calibrations are within 5 %."""
NO_SWITCH = "the operator's device has no enabling switch: it pushes whether or not a hand holds it"
OVERSPEED_RATIO = 1.2
"""Over velocity_max, beyond the noise of a difference."""
POSITION_SHARE = 0.05
"""Of the travel: by how much encoder and drive may disagree since power came on, as of a slave."""
ALIGN_S = 0.020
"""So long after power came on the drive's zero is taken to be the encoder's."""


Window = NDArray[np.float64]
_NO_FAULT, _DEVICE, _NOT_ENABLED = faults.NO_FAULT.code, faults.DEVICE.code, faults.NOT_ENABLED.code
_STALE, _RELEASED, _FORCE_OFF = faults.STALE.code, faults.RELEASED.code, faults.FORCE_OFF.code
_OVERSPEED, _END_OF_TRAVEL = faults.OVERSPEED.code, faults.END_OF_TRAVEL.code
_POSITION_OFF = faults.POSITION_OFF.code
_VALID, _ENABLED, _SWITCH = map(sample_place, ("valid", "enabled", "switch"))
_FAULT, _NONE = sample_place("fault"), int(NO_AXIS_FAULT)
_POSITION, _DRIVE_POSITION = sample_place("position"), sample_place("drive_position")
_DRIVE_FORCE = sample_place("drive_force")
_HAS_POSITION, _HAS_FORCE = map(sample_place, ("has_drive_position", "has_drive_force"))


class WatchFields:
    """Fields of the watch's record: properties of the device, then observations."""

    period_s: float
    position_min: float
    position_max: float
    velocity_max: float
    force_max: float
    apart_max: float
    has_switch: int
    has_position: int
    has_force: int
    stale_s: float
    waiting_s: float
    off_s: float
    enabled: int
    apart: float
    powered_s: float
    place: int


WATCHED_TYPE = record_type(WatchFields)
StoredWatch = NDArray[np.record]


@kernel
def extremes(window: Window) -> tuple[float, float]:
    """Return the least and the largest of the recent commands."""
    least = most = window[0]
    for asked in window:
        least, most = min(least, asked), max(most, asked)
    return least, most


@kernel
def is_off(watch: WatchFields, least: float, most: float, force: float) -> bool:
    """Return whether the motor's force has differed from the command for too long."""
    if watch.has_force == 0:
        return False
    slack = FORCE_SHARE * watch.force_max
    off = not least - slack <= force <= most + slack
    watch.off_s = watch.off_s + watch.period_s if off else 0.0
    return watch.off_s >= FORCE_OFF_S


@kernel
def is_elsewhere(watch: WatchFields, position: float, drive: float) -> bool:
    """Return whether the drive has moved another way than the encoder since it has power."""
    if watch.has_position == 0:
        return False
    watch.powered_s += watch.period_s
    if watch.powered_s <= ALIGN_S:
        watch.apart = position - drive
    return not abs(position - drive - watch.apart) <= watch.apart_max


@kernel
def judge_motion(watch: WatchFields, position: float, velocity: float) -> int:
    """Return the fault of a device that is too fast or has left its travel."""
    if not abs(velocity) <= OVERSPEED_RATIO * watch.velocity_max:
        return _OVERSPEED
    inside = watch.position_min <= position <= watch.position_max
    return _NO_FAULT if inside else _END_OF_TRAVEL


@kernel
def judge_enabled(
    watch: WatchFields,
    window: Window,
    closed: bool,
    position: float,
    velocity: float,
    drive_position: float,
    drive_force: float,
) -> int:
    """Return the fault of a device under power."""
    watch.enabled = 1
    if watch.stale_s >= STALE_S - 0.5 * watch.period_s:
        return _STALE
    least, most = extremes(window)
    if watch.has_switch > 0 and not closed and (least < 0.0 or most > 0.0):
        return _RELEASED
    if is_off(watch, least, most, drive_force):
        return _FORCE_OFF
    found = judge_motion(watch, position, velocity)
    if is_elsewhere(watch, position, drive_position) and found == _NO_FAULT:
        return _POSITION_OFF
    return found


@kernel
def judge(
    stored: StoredWatch,
    window: Window,
    valid: bool,
    enabled: bool,
    closed: bool,
    failed: bool,
    position: float,
    velocity: float,
    drive_position: float,
    drive_force: float,
) -> int:
    """Return the fault in a cycle's sample; a quantity that is missing is not a number."""
    watch: Any = stored[0]
    watch.stale_s = 0.0 if valid else watch.stale_s + watch.period_s
    if failed:
        return _DEVICE
    if enabled:
        return judge_enabled(watch, window, closed, position, velocity, drive_position, drive_force)
    watch.waiting_s += watch.period_s
    missing = watch.enabled > 0 or watch.waiting_s > ENABLING_S
    return _NOT_ENABLED if missing else _NO_FAULT


@kernel
def note_command(stored: StoredWatch, window: Window, force: float) -> None:
    """Note the force that was asked for; without power, none."""
    watch: Any = stored[0]
    asked = force if watch.enabled > 0 and math.isfinite(force) else 0.0
    window[watch.place] = max(-watch.force_max, min(watch.force_max, asked))
    watch.place = (watch.place + 1) % len(window)


class HandleWatch:
    """Judges a device's samples; `fault` is the first thing found wrong.

    `lacks` are the safeguards that the device goes without, each with a sentence.
    Values that it measures twice are compared, and must be there.
    """

    def __init__(
        self,
        limits: Limits,
        period_s: float,
        switch: EnablingSwitch = "none",
        lacks: Mapping[UnsafeWord, str] = MappingProxyType({}),
    ) -> None:
        self._limits, self._lacks, self._switch = limits, lacks, switch
        stored: StoredWatch = np.zeros(1, WATCHED_TYPE)
        self._watched = w = cast("WatchFields", stored[0])
        w.period_s, w.force_max, w.velocity_max = period_s, limits.force_max, limits.velocity_max
        w.position_min, w.position_max = limits.position_min, limits.position_max
        w.apart_max = POSITION_SHARE * (limits.position_max - limits.position_min)
        w.has_switch = switch != "none"
        w.has_position = "position_comparison" not in lacks
        w.has_force = "force_comparison" not in lacks
        self._window: Window = np.zeros(max(2, round(FORCE_WINDOW_S / period_s)))
        flags, numbers = (False,) * 4, (0.0,) * 4
        self._judge = bound(judge, (stored, self._window), *flags, *numbers)
        self._note_command = bound(note_command, (stored, self._window), 0.0)
        self.reset()

    def reset(self) -> None:
        """Forget every fault."""
        self.fault = faults.NO_FAULT
        w = self._watched
        w.stale_s = w.waiting_s = w.off_s = w.apart = w.powered_s = 0.0
        w.enabled = w.place = 0
        self._window[:] = 0.0

    @property
    def travel(self) -> tuple[float, float]:
        """The ends of the device's travel, where it is let go."""
        return self._limits.position_min, self._limits.position_max

    @property
    def unsafe(self) -> list[str]:
        """Protections that the device lacks, in sentences."""
        return [*([NO_SWITCH] if self._switch == "none" else []), *self._lacks.values()]

    def let_go(self, fault: faults.HandleFault) -> None:
        """Latch a fault that was found elsewhere; the first one stays."""
        if self.fault is faults.NO_FAULT:
            self.fault = fault

    def commanded(self, force: float) -> None:
        """Note the force along x that was asked for in this cycle; without power, none."""
        self._note_command(force)

    def update(self, sample: Sample, velocity: float) -> None:
        """Judge a cycle's sample, and the velocity that came out of it."""
        if self.fault is not faults.NO_FAULT:
            return
        floats, counts = sample.floats, sample.counts  # without a call for each number
        found = self._judge(
            counts[_VALID] > 0,
            counts[_ENABLED] > 0,
            counts[_SWITCH] > 0,
            counts[_FAULT] != _NONE,
            floats[_POSITION],
            velocity,
            floats[_DRIVE_POSITION] if counts[_HAS_POSITION] else math.nan,
            floats[_DRIVE_FORCE] if counts[_HAS_FORCE] else math.nan,
        )
        if found:
            self.fault = faults.HANDLE_FAULTS[found]
