"""The operator's device of a rig: its body and the key that enables it."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import Field, model_validator

from teleop_rt.config.section import (
    Damping,
    Force,
    Mass,
    Position,
    Section,
)

EnablingSwitch = Literal["none", "switch", "key"]


class EnablingKey(Section):
    """A key of an input device that must be held, read from the kernel's own events."""

    device: str = Field(
        min_length=1,
        description="Input device, a path below /dev/input/by-id.",
    )
    code: int = Field(
        57, ge=1, le=767, description="Code of the key (linux/input-event-codes.h); 57 is space."
    )


class DeviceBody(Section):
    """Physical properties of an operator's device, by its data sheet or a calibration.

    The passivity bound relies on damping and latency; a simulated device has these properties.
    """

    mass: Mass = Field(gt=0, description="Moving mass (or inertia) that the hand feels.")
    damping: Damping = Field(
        ge=0, description="Viscous friction, at its least over the travel; do not overstate it."
    )
    coulomb_friction: Force = Field(0.0, ge=0, description="Dry friction; no bound relies on it.")
    end_stop_min: Position = Field(description="Lower mechanical end of the travel.")
    end_stop_max: Position = Field(description="Upper mechanical end of the travel.")
    force_bandwidth_hz: float = Field(
        1000.0, ge=20, le=20_000, description="Bandwidth of the drive's force, first order."
    )
    force_latency_ms: float = Field(
        0.0, ge=0, le=20, description="Time from a command that has arrived to its force."
    )
    position_latency_ms: float = Field(
        0.0, ge=0, le=20, description="Age of a position when the device latches it."
    )
    enabling: EnablingSwitch = Field(
        "none",
        description=(
            "Condition for any force on the device: its digital input is closed (switch), a key is "
            "held (key), or no condition (none), which is shown in red."
        ),
    )
    enabling_key: EnablingKey | None = Field(
        None, description="With enabling: key, the input device and its key."
    )

    @model_validator(mode="after")
    def _ordered(self) -> DeviceBody:
        if self.end_stop_min >= self.end_stop_max:
            raise ValueError("end_stop_min must be below end_stop_max")
        if (self.enabling == "key") != (self.enabling_key is not None):
            raise ValueError("enabling_key is only for enabling: key")
        return self

    @property
    def latency_s(self) -> float:
        """Return the device's own share of the latency, its bandwidth counted as a delay."""
        lag_s = 1 / (2 * math.pi * self.force_bandwidth_hz)
        return 1e-3 * (self.force_latency_ms + self.position_latency_ms) + lag_s
