"""Config of a simulated plant: the trial's `plant` section, which the daemon never sees."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, field_validator

from teleop_rt.config.section import (
    Damping,
    Force,
    ForceRate,
    Mass,
    Position,
    Quantity,
    Section,
    Stiffness,
)
from teleop_rt.config.trial import PlantConfig
from teleop_rt_drivers.simulated.hidden_config import HiddenEffectConfig


class HuntCrossley(Section):
    """A body that is soft at its surface: k d (x/d)^n + b (x/d)^n v (Hunt and Crossley 1975)."""

    exponent: float = Field(ge=1, le=3, description="Exponent n; 1.5 for a ball on a plane.")
    depth: Position = Field(
        gt=0, description="Penetration d at which secant stiffness and damping are k and b."
    )


class EnvironmentConfig(Section):
    """A Kelvin-Voigt body: max(0, k x + b v) for penetration x >= 0, nothing outside."""

    stiffness: Stiffness = Field(gt=0, description="Stiffness of the simulated body.")
    damping: Damping = Field(ge=0, description="Damping of the simulated body.")
    surface: Position = Field(description="Position of the body's surface.")
    hunt_crossley: HuntCrossley | None = Field(
        None, description="Power of the penetration in the body's law; null for Kelvin-Voigt."
    )

    @property
    def power(self) -> tuple[float, float]:
        """Return exponent and depth of the law's power; 1 and 0 where it is linear."""
        law = self.hunt_crossley
        return (1.0, 0.0) if law is None else (law.exponent, law.depth)


class SensorConfig(Section):
    """Errors of the simulated sensors."""

    encoder_resolution: Position = Field(
        gt=0, description="Step of the simulated encoder, one count."
    )
    encoder_zero: Position = Field(
        0.0, description="True position at which the simulated encoder counts zero."
    )
    home_switch: Annotated[
        float | None, Quantity("{x}"), Field(description="closed from here downwards")
    ] = Field(
        None,
        description=(
            "True position at and below which the home switch is closed; null for no switch."
        ),
    )
    force_offset: Force = Field(
        0.0, description="Force that the simulated sensor reads in free air."
    )
    force_drift: ForceRate = Field(
        0.0, description="Rate at which that offset changes, from the start on."
    )
    force_noise: Force = Field(
        0.0, ge=0, description="Standard deviation of the simulated sensor's white noise."
    )
    force_lag_ms: float = Field(
        0.0, ge=0, le=20, description="Time by which the simulated force lags behind the position."
    )
    force_lag_jitter_us: float = Field(
        0.0, ge=0, le=1000, description="Jitter of that lag, uniform within plus or minus this."
    )


class ServoConfig(Section):
    """A drive that holds its reference by a stiff spring and damper, with velocity feedforward."""

    mass: Mass = Field(gt=0, description="Mass (or inertia) that the simulated drive moves.")
    bandwidth_hz: float = Field(
        100.0, ge=10, le=500, description="Natural frequency of the simulated position loop."
    )
    damping_ratio: float = Field(
        1.0,
        ge=0.3,
        le=3,
        description="Damping ratio of the simulated position loop; 1 does not overshoot.",
    )
    idle_damping: Damping = Field(
        200.0,
        ge=0,
        description="Damping by brake and friction while the simulated drive is without power.",
    )
    force_max: Force = Field(gt=0, description="Largest force of the simulated drive.")
    position_resolution: Position = Field(
        gt=0, description="Position of one count of the simulated drive."
    )
    zero: Position = Field(
        0.0, description="True position at which the simulated drive counts zero."
    )


class SimulatedPlantConfig(PlantConfig):
    """The whole plant."""

    environment: EnvironmentConfig = Field(description="The body that the tool presses on.")
    sensors: SensorConfig = Field(description="What the simulated sensors do to the truth.")
    drive: ServoConfig = Field(description="The simulated servo drive.")
    start: Position = Field(0.0, description="True position of the tool at the start.")
    undeclared: tuple[HiddenEffectConfig, ...] = Field(
        (),
        description=(
            "Effects hidden in the plant, each at most once; only the plant knows of them, and "
            "`diagnose` should find them."
        ),
    )

    @field_validator("undeclared")
    @classmethod
    def _each_once(cls, value: tuple[HiddenEffectConfig, ...]) -> tuple[HiddenEffectConfig, ...]:
        names = [hidden.effect for hidden in value]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is listed more than once")
        if {"coulomb_friction", "stribeck_friction"} <= set(names):
            raise ValueError("a guide has coulomb_friction or stribeck_friction, not both")
        return value
