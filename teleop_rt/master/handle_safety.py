"""The safety chain of the operator's device: what takes its force away, within 20 ms.

Each hazard is judged on what the device itself says, every cycle, and the first one is latched: a
device that was let go pushes no more until the master restarts.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType

from teleop_rt.axis import AxisFault, Sample
from teleop_rt.config_device import EnablingSwitch
from teleop_rt.config_rig import Limits
from teleop_rt.config_supervision import UnsafeWord
from teleop_rt.master import handle_faults as faults

STALE_S = 0.010
"""Age of the newest valid sample at which its force is no answer any more."""
ENABLING_S = 2.0
"""A drive takes less to follow; until it does, no force is felt and nothing is wrong."""
FORCE_OFF_S = 0.005
"""How long a force may lie outside of what was commanded lately: a settling current does less."""
FORCE_WINDOW_S = 0.010
"""Window of recent commands: longer than any bus and drive take to answer."""
FORCE_SHARE = 0.1
"""Of force_max: by how much a motor's force may be off; calibrations are within 5 %."""
NO_SWITCH = "the operator's device has no enabling switch: it pushes whether or not a hand holds it"
OVERSPEED = 1.2
"""Over velocity_max, beyond the noise of a difference."""
POSITION_SHARE = 0.05
"""Of the travel: by how much encoder and drive may disagree since power came on, as of a slave."""
ALIGN_S = 0.020
"""So long after power came on the drive's zero is taken to be the encoder's."""


class HandleWatch:
    """Judges a device's samples; `fault` is the first thing found wrong.

    `lacks` are the safeguards that the device goes without, each with a sentence: what it
    measures twice is compared, and must be there.
    """

    def __init__(
        self,
        limits: Limits,
        period_s: float,
        switch: EnablingSwitch = "none",
        lacks: Mapping[UnsafeWord, str] = MappingProxyType({}),
    ) -> None:
        self._limits = limits
        self._lacks = lacks
        self._has_position = "position_comparison" not in lacks
        self._has_force = "force_comparison" not in lacks
        self._position_max = POSITION_SHARE * (limits.position_max - limits.position_min)
        self._period_s = period_s
        self._switch = switch
        self._window = [0.0] * max(2, round(FORCE_WINDOW_S / period_s))
        self.reset()

    def reset(self) -> None:
        """Forget every fault."""
        self.fault = faults.NO_FAULT
        self._stale_s = self._waiting_s = self._off_s = 0.0
        self._enabled = False
        self._difference = self._powered_s = 0.0
        self._at = 0
        self._window[:] = [0.0] * len(self._window)

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
        most = self._limits.force_max
        asked = force if self._enabled and math.isfinite(force) else 0.0
        self._window[self._at] = max(-most, min(most, asked))
        self._at = (self._at + 1) % len(self._window)

    def update(self, sample: Sample, velocity: float) -> None:
        """Judge a cycle's sample, and the velocity that came out of it."""
        if self.fault is faults.NO_FAULT:
            self._stale_s = 0.0 if sample.valid else self._stale_s + self._period_s
            self.fault = self._judge(sample, velocity)

    def _judge(self, sample: Sample, velocity: float) -> faults.HandleFault:
        if sample.fault is not AxisFault.NONE:
            return faults.DEVICE
        if not sample.enabled:
            self._waiting_s += self._period_s
            missing = self._enabled or self._waiting_s > ENABLING_S
            return faults.NOT_ENABLED if missing else faults.NO_FAULT
        return self._judge_enabled(sample, velocity)

    def _judge_enabled(self, sample: Sample, velocity: float) -> faults.HandleFault:
        self._enabled = True
        if self._stale_s >= STALE_S - 0.5 * self._period_s:
            return faults.STALE
        if self._switch != "none" and not sample.switch and any(self._window):
            return faults.RELEASED
        if self._is_off(sample.drive_force):
            return faults.FORCE_OFF
        found = self._judge_motion(sample.position, velocity)
        if self._is_elsewhere(sample) and found is faults.NO_FAULT:
            return faults.POSITION_OFF
        return found

    def _is_elsewhere(self, sample: Sample) -> bool:
        """Return whether the drive has moved another way than the encoder since it has power."""
        if not self._has_position:
            return False
        drive = math.nan if sample.drive_position is None else sample.drive_position
        difference = sample.position - drive
        self._powered_s += self._period_s
        if self._powered_s <= ALIGN_S:
            self._difference = difference
        return not abs(difference - self._difference) <= self._position_max

    def _judge_motion(self, position: float, velocity: float) -> faults.HandleFault:
        limits = self._limits
        if not abs(velocity) <= OVERSPEED * limits.velocity_max:
            return faults.OVERSPEED
        inside = limits.position_min <= position <= limits.position_max
        return faults.NO_FAULT if inside else faults.END_OF_TRAVEL

    def _is_off(self, force: float | None) -> bool:
        """Return whether the motor's force has not been what was commanded for too long."""
        if not self._has_force:
            return False
        if force is None:
            force = math.nan
        slack = FORCE_SHARE * self._limits.force_max
        off = not min(self._window) - slack <= force <= max(self._window) + slack
        self._off_s = self._off_s + self._period_s if off else 0.0
        return self._off_s >= FORCE_OFF_S
