"""What a simulated plant is told: the trial's `plant` section, which the daemon never sees."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from teleop_rt.config import PlantConfig
from teleop_rt.section import (
    Damping,
    Force,
    ForceRate,
    Mass,
    Position,
    Quantity,
    Section,
    Stiffness,
)
from teleop_rt_drivers.simulated.hidden_config import HiddenEffectConfig


class EnvironmentConfig(Section):
    """A Kelvin-Voigt body: max(0, k x + b v) for penetration x >= 0, nothing outside."""

    stiffness: Stiffness = Field(gt=0)
    damping: Damping = Field(ge=0)
    surface: Position


class SensorConfig(Section):
    """What the sensors do to the truth."""

    encoder_resolution: Position = Field(gt=0)
    encoder_zero: Position = Field(0.0, description="true position at which it counts zero")
    home_switch: Annotated[
        float | None, Quantity("{x}"), Field(description="closed from here downwards")
    ] = None
    force_offset: Force = Field(0.0, description="what it reads in free air")
    force_drift: ForceRate = Field(0.0, description="change of the offset, from the start on")
    force_noise: Force = Field(0.0, ge=0, description="standard deviation, white")
    force_lag_ms: float = Field(0.0, ge=0, le=20)
    force_lag_jitter_us: float = Field(0.0, ge=0, le=1000, description="uniform, plus or minus")


class ServoConfig(Section):
    """A drive that holds its reference by a stiff spring and damper, with velocity feedforward."""

    mass: Mass = Field(gt=0)
    bandwidth_hz: float = Field(100.0, ge=10, le=500)
    damping_ratio: float = Field(1.0, ge=0.3, le=3)
    idle_damping: Damping = Field(200.0, ge=0, description="brake and friction without power")
    force_max: Force = Field(gt=0)
    position_resolution: Position = Field(gt=0, description="one count of the drive")
    zero: Position = Field(0.0, description="true position at which it counts zero")


class SimulatedPlantConfig(PlantConfig):
    """The whole plant."""

    environment: EnvironmentConfig
    sensors: SensorConfig
    drive: ServoConfig
    start: Position = 0.0
    undeclared: tuple[HiddenEffectConfig, ...] = Field(
        (), description="effects that the daemon is not told of"
    )

    @field_validator("undeclared")
    @classmethod
    def _each_once(cls, value: tuple[HiddenEffectConfig, ...]) -> tuple[HiddenEffectConfig, ...]:
        names = [hidden.effect for hidden in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} stands here more than once")
        if {"coulomb_friction", "stribeck_friction"} <= set(names):
            raise ValueError("a guide has coulomb_friction or stribeck_friction, not both")
        return value
