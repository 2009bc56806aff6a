"""The `axis` sections of drives on half-duplex serial lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from pydantic import Field, model_validator

from teleop_rt_drivers.actuators.dynamixel import (
    WATCHDOG_STEP_MS,
    DynamixelCodec,
    ServoLimits,
)
from teleop_rt_drivers.actuators.feetech import FeetechCodec
from teleop_rt_drivers.actuators.part import LineActuatorPart

if TYPE_CHECKING:
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.codec import AngleUnit


class DynamixelPart(LineActuatorPart):
    """A Dynamixel of the X series on protocol 2."""

    driver: Literal["dynamixel"] = Field(
        description="A Dynamixel of the X series that knows currents, on protocol 2."
    )
    servo_id: int = Field(1, ge=0, le=252, description="The drive's id.")
    torque_constant_Nm_per_A: float = Field(
        gt=0,
        le=100,
        description="Torque of the output per current: stall torque over stall current.",
    )
    current_max_A: float = Field(
        gt=0, le=10, description="Limit of the motor's current, written to the drive."
    )
    current_per_count_mA: float = Field(
        2.69,
        gt=0,
        le=100,
        description="Unit of the drive's currents: 2.69 of most models, 1 of XL330 and XC330.",
    )
    watchdog_ms: int = Field(
        60,
        ge=WATCHDOG_STEP_MS,
        le=127 * WATCHDOG_STEP_MS,
        multiple_of=WATCHDOG_STEP_MS,
        description="Silence after which the drive stops where it is, written to it.",
    )

    @property
    def unit(self) -> AngleUnit:
        """Return turns."""
        return "turn"

    def codec(self, rig: RigConfig) -> DynamixelCodec:
        """Return protocol 2 with the rig's top speed, the current's limit and the watchdog."""
        limits = ServoLimits(
            rig.limits.velocity_max / self.scale,
            self.current_max_A,
            1e-3 * self.current_per_count_mA,
            self.watchdog_ms,
        )
        return DynamixelCodec(self.servo_id, self.torque_constant_Nm_per_A, limits)


class FeetechPart(LineActuatorPart):
    """A Feetech servo of the STS or SMS series."""

    driver: Literal["feetech"] = Field(description="A Feetech servo of the STS or SMS series.")
    servo_id: int = Field(1, ge=0, le=253, description="The servo's id.")
    torque_constant_Nm_per_A: float = Field(
        gt=0,
        le=100,
        description="Torque of the output per current: stall torque over stall current.",
    )
    torque_limit_share: float = Field(
        1.0, gt=0, le=1, description="Share of its largest torque that the servo may use."
    )

    @property
    def unit(self) -> AngleUnit:
        """Return turns."""
        return "turn"

    def codec(self, rig: RigConfig) -> FeetechCodec:
        """Return the protocol with the rig's top speed and the torque's limit."""
        fastest = rig.limits.velocity_max / self.scale
        share = self.torque_limit_share
        return FeetechCodec(self.servo_id, self.torque_constant_Nm_per_A, fastest, share)

    @model_validator(mode="after")
    def _watches_nobody(self) -> FeetechPart:
        if self.watchdog_ms is not None:
            raise ValueError("watchdog_ms must be null: these servos have no time-out for commands")
        return self
