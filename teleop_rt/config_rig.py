"""The schema of rigs: units, rate, sensors, limits, zeros, and how the devices are reached."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, SerializeAsAny, model_validator

from teleop_rt.section import (
    Acceleration,
    Force,
    ForceRate,
    Position,
    Quantity,
    Section,
    Units,
    Velocity,
)


class AxisConfig(Section):
    """What every driver's section has; each driver extends it with its own keys."""

    driver: str


class Sensors(Section):
    """What is known of the sensors: it sets thresholds and noise floors."""

    position_resolution: Position = Field(gt=0)
    force_noise: Force = Field(gt=0, description="standard deviation")
    force_lag_ms: float = Field(
        0.0, ge=-50, le=50, description="lag of force behind position that a calibration found"
    )


class Limits(Section):
    """What no command may ever exceed."""

    position_min: Position
    position_max: Position
    velocity_max: Velocity = Field(gt=0)
    acceleration_max: Acceleration = Field(gt=0)
    force_max: Force = Field(gt=0)

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.position_min >= self.position_max:
            raise ValueError("position_min must be below position_max")
        return self


class TareConfig(Section):
    """The force sensor's zero, found at rest in free air before the axis can be armed."""

    duration_ms: float = Field(500, ge=20, le=10_000)
    offset_max: Force = Field(gt=0, description="a larger mean is a contact, and is refused")
    noise_max: Force = Field(gt=0, description="largest standard deviation")
    drift_max: ForceRate = Field(gt=0)


class HomingConfig(Section):
    """The position's zero, found under power: to a switch, or by touching something fixed.

    The tool goes in `direction` until it finds it, draws back, comes again slowly, takes the
    place for `position`, and draws back.
    """

    to: Literal["switch", "touch"]
    position: Position = Field(description="where the switch, or what is touched, truly is")
    direction: Literal[1, -1] = -1
    search: Position = Field(gt=0, description="longest way to look for it")
    back_off: Position = Field(gt=0, description="how far to draw back")
    speed: Velocity = Field(gt=0)
    slow_speed: Velocity = Field(gt=0, description="of the second approach, which decides")
    touch_force: Annotated[
        float | None, Quantity("{f}"), Field(gt=0, description="what a touch is felt by")
    ] = None

    @model_validator(mode="after")
    def _slower(self) -> HomingConfig:
        if self.slow_speed > self.speed:
            raise ValueError("slow_speed must not be above speed")
        if (self.to == "touch") != (self.touch_force is not None):
            raise ValueError("touch_force belongs to homing by touch, and only to that")
        return self


class ReferenceConfig(Section):
    """How the rig finds its zeros before it follows anybody; what is left out is trusted."""

    tare: TareConfig | None = None
    homing: HomingConfig | None = None

    @model_validator(mode="after")
    def _touch_is_felt(self) -> ReferenceConfig:
        touch = None if self.homing is None else self.homing.touch_force
        if touch is not None and (self.tare is None or touch <= self.tare.offset_max):
            raise ValueError("homing by touch needs tare, and touch_force above tare's offset_max")
        return self


class RealtimeConfig(Section):
    """What the slave's loop asks of the machine; what is refused is reported, and goes without."""

    priority: int = Field(60, ge=1, le=98, description="of SCHED_FIFO")
    cpu: int | None = Field(
        None, ge=0, description="the core that the loop is pinned to, and others keep off"
    )
    awake: bool = Field(default=False, description="keep the processor out of deep sleep")
    spin_us: float = Field(0, ge=0, le=200, description="wait without sleep before a deadline")


class RecordingConfig(Section):
    """How a recording is cut into parts, and how much of it is kept; the parts are read as one."""

    part_MB: float = Field(
        250.0, ge=1, description="a part that is as large is followed by another"
    )
    part_s: float = Field(3600.0, ge=1, description="and so is one that is as old")
    kept_MB: float = Field(20_000.0, ge=1, description="beyond that the oldest parts are removed")
    kept_parts: int | None = Field(None, ge=2, description="or beyond so many")


class RigConfig(Section):
    """A rig: its units, rate, limits and how its devices are reached."""

    format: int = Field(1, description="of this file")
    name: str = Field(min_length=1)
    units: Units
    rate_hz: int = Field(ge=100, le=4000)
    sensors: Sensors
    limits: Limits
    realtime: RealtimeConfig = RealtimeConfig()
    reference: ReferenceConfig = ReferenceConfig()
    recording: RecordingConfig = RecordingConfig()
    axis: SerializeAsAny[AxisConfig]

    @model_validator(mode="after")
    def _homes_within_limits(self) -> RigConfig:
        homing = self.reference.homing
        if homing is not None and homing.speed > self.limits.velocity_max:
            raise ValueError("reference.homing.speed must not be above limits.velocity_max")
        touch = None if homing is None else homing.touch_force
        if touch is not None and touch >= self.limits.force_max:
            raise ValueError("reference.homing.touch_force must be below limits.force_max")
        return self

    @property
    def period_ns(self) -> int:
        """Length of one cycle."""
        return round(1e9 / self.rate_hz)
