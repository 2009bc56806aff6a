"""Conversion of device numbers to rig units, and the possible values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final, Literal

if TYPE_CHECKING:
    from teleop_rt.config.rig import RigConfig

DriveZero = Literal["encoder", "unknown"]
"""Zero of a drive's position: that of the encoder, or unknown, as before homing.

Where it is unknown, the first position that is commanded under power is taken as that where the
drive stands: so it cannot jump.
"""

FromDrive = Literal["from drive"]
"""Choice of a rig without a sensor, which takes a measured value from its drive."""
FROM_DRIVE: Final = "from drive"
FromInput = Literal["from drive input"]
"""Choice of a rig whose force sensor is wired to an analog input of its drive."""
FROM_INPUT: Final = "from drive input"

SPEED_MARGIN = 2.0
"""A position that moves faster than this times the rig's velocity limit is no position."""
FORCE_MARGIN = 3.0
"""A force beyond this times the rig's force limit is no force."""
JUMP_SLACK = 10.0
"""Encoder steps that a position may always change by."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Device counts to rig units: value = offset + sign * scale * counts."""

    per_count: float
    sign: int
    offset: float

    def moved(self, by: float) -> Scale:
        """Return the scale whose values are larger by this [rig unit]."""
        return replace(self, offset=self.offset + by)

    def value(self, counts: float) -> float:
        """Return the value [rig unit] of device counts."""
        return self.offset + self.sign * self.per_count * counts

    def raw(self, value: float) -> float:
        """Return the device's number of a value [rig unit], not rounded."""
        return self.sign * (value - self.offset) / self.per_count

    def counts(self, value: float) -> int:
        """Return the nearest device counts of a value [rig unit]."""
        return round(self.sign * (value - self.offset) / self.per_count)  # as `raw`, in one call


@dataclass(frozen=True, slots=True)
class Plausible:
    """Plausible values [rig unit]: within a range, and changing by at most `rate` per second.

    `slack` is the change that is always allowed (quantisation, noise).
    """

    lower: float
    upper: float
    rate: float
    slack: float


def plausible_position(rig: RigConfig) -> Plausible:
    """Return the possible positions: near the rig's travel, not much faster than its limit."""
    limits = rig.limits
    travel = limits.position_max - limits.position_min
    return Plausible(
        lower=limits.position_min - travel,
        upper=limits.position_max + travel,
        rate=SPEED_MARGIN * limits.velocity_max,
        slack=JUMP_SLACK * rig.sensors.position_resolution,
    )


def plausible_force(rig: RigConfig) -> Plausible:
    """Return the possible forces: they may jump, but not out of range."""
    most = FORCE_MARGIN * rig.limits.force_max
    return Plausible(lower=-most, upper=most, rate=0.0, slack=math.inf)
