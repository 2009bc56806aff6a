"""Effects that a trial hides in the plant: `plant.undeclared`, which only the plant may know.

Each has the name that diagnosis should find, and parameters of its own physics: the law that is
integrated here is never the one that is fitted there.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from teleop_rt.config.section import Damping, Force, Mass, Position, Quantity, Velocity
from teleop_rt_drivers.simulated import hidden
from teleop_rt_drivers.simulated.hidden_body import (
    Adhesion,
    Constants,
    HiddenEffect,
    Hysteresis,
    MovingSurface,
    MullinsSoftening,
    NonlinearStiffening,
    PermanentSet,
    QuadraticDamping,
    SecondLayer,
    Softening,
    StressRelaxation,
)


class CoulombFriction(HiddenEffect):
    """Dry friction of the guide as LuGre: bristles of the stiffness F / travel, and damping."""

    effect: Literal["coulomb_friction"] = Field(
        description="Dry friction of the guide (LuGre without a breakaway peak)."
    )
    friction_force: Force = Field(gt=0, description="Friction force while sliding.")
    presliding_travel: Position = Field(
        1e-4, gt=0, description="Travel over which the bristles yield before the guide slides."
    )

    def constants(self) -> dict[int, float]:
        """Return the constants of LuGre without a Stribeck peak."""
        force = self.friction_force
        return {hidden.KINETIC: force, hidden.STATIC: force, hidden.STRIBECK_VELOCITY: 1.0,
                hidden.BRISTLE: force / self.presliding_travel}  # fmt: skip


class StribeckFriction(HiddenEffect):
    """LuGre with a breakaway force above the kinetic one: it sticks and slips."""

    effect: Literal["stribeck_friction"] = Field(
        description="Friction of the guide with a breakaway peak: it sticks and slips (LuGre)."
    )
    friction_force: Force = Field(gt=0, description="Friction force at high speed.")
    breakaway_force: Force = Field(
        gt=0, description="Friction force at rest, usually above friction_force."
    )
    stribeck_velocity: Velocity = Field(
        gt=0, description="Speed over which the force falls from the breakaway to the sliding one."
    )
    presliding_travel: Position = Field(
        1e-4, gt=0, description="Travel over which the bristles yield before the guide slides."
    )

    def constants(self) -> dict[int, float]:
        """Return the constants of LuGre."""
        return {hidden.KINETIC: self.friction_force, hidden.STATIC: self.breakaway_force,
                hidden.STRIBECK_VELOCITY: self.stribeck_velocity,
                hidden.BRISTLE: self.friction_force / self.presliding_travel}  # fmt: skip


class ViscousFriction(HiddenEffect):
    """Lubricant in the guide."""

    effect: Literal["viscous_friction"] = Field(
        description="Viscous friction of the guide's lubricant."
    )
    damping: Damping = Field(gt=0, description="Coefficient of the viscous friction.")
    columns: ClassVar[Constants] = {"damping": hidden.VISCOUS}


class DirectionDependentDamping(HiddenEffect):
    """A seal that drags more when moving in."""

    effect: Literal["direction_dependent_damping"] = Field(
        description="A seal that drags more when the tool moves in."
    )
    extra_forward_damping: Damping = Field(
        gt=0, description="Damping that is added while the tool moves towards the environment."
    )
    columns: ClassVar[Constants] = {"extra_forward_damping": hidden.FORWARD}


class ToolInertia(HiddenEffect):
    """A mass between the sensor and the body."""

    effect: Literal["tool_inertia"] = Field(
        description="A mass between the force sensor and the body."
    )
    mass: Mass = Field(gt=0, description="Mass (or inertia) of the tool beyond the sensor.")
    columns: ClassVar[Constants] = {"mass": hidden.TOOL_MASS}


class ForceBias(HiddenEffect):
    """A sensor that was not zeroed."""

    effect: Literal["force_bias"] = Field(description="A force sensor that was not zeroed.")
    bias: Force = Field(description="Force that the sensor adds, of either sign.")
    columns: ClassVar[Constants] = {"bias": hidden.BIAS}


class ForceDrift(HiddenEffect):
    """A sensor that warms up in two stages."""

    effect: Literal["force_drift"] = Field(
        description="A force sensor whose zero drifts while it warms up."
    )
    drift: Force = Field(description="Drift of the zero in the end, of either sign.")
    time_constant_s: float = Field(
        gt=0.01, le=86_400, description="Time constant of the slower of two stages of warming up."
    )
    columns: ClassVar[Constants] = {"drift": hidden.DRIFT, "time_constant_s": hidden.DRIFT_TIME}


class PeriodicDisturbance(HiddenEffect):
    """Mains in the sensor's cable, with a third harmonic."""

    effect: Literal["periodic_disturbance"] = Field(
        description="Mains hum in the force signal, with a third harmonic."
    )
    amplitude: Force = Field(gt=0, description="Amplitude of the fundamental.")
    frequency_hz: float = Field(
        gt=0, le=400, description="Frequency of the fundamental; 50 or 60 for mains."
    )
    columns: ClassVar[Constants] = {"amplitude": hidden.MAINS, "frequency_hz": hidden.MAINS_HZ}


class ForceLag(HiddenEffect):
    """A sensor whose spring and mass make a low-pass of the second order."""

    effect: Literal["force_lag"] = Field(
        description="A slow force sensor: a low-pass of the second order."
    )
    cutoff_hz: float = Field(ge=1, le=1000, description="Natural frequency of the low-pass.")
    damping_ratio: float = Field(1.0, ge=0.3, le=3, description="Damping ratio of the low-pass.")
    columns: ClassVar[Constants] = {
        "cutoff_hz": hidden.SENSOR_HZ,
        "damping_ratio": hidden.SENSOR_DAMPING,
    }


class ForceSaturation(HiddenEffect):
    """An amplifier that runs into its supply over a soft knee."""

    effect: Literal["force_saturation"] = Field(
        description="An amplifier that runs into its supply over a soft knee."
    )
    level: Force = Field(gt=0, description="Force at which the reading saturates.")
    columns: ClassVar[Constants] = {"level": hidden.LEVEL}


class Outliers(HiddenEffect):
    """Sparks: a share of the samples is off by about `size`."""

    effect: Literal["outliers"] = Field(description="Single samples of force that are far off.")
    share: float = Field(gt=0, le=0.1, description="Share of the samples that are far off.")
    size: Force = Field(gt=0, description="Typical size of the error, of either sign.")
    columns: ClassVar[Constants] = {"share": hidden.SPARKS, "size": hidden.SPARK_SIZE}


class ChannelDelay(HiddenEffect):
    """A force channel that is late by more than its calibration found."""

    effect: Literal["channel_delay"] = Field(
        description="A force channel that is late by more than its calibration found."
    )
    delay_ms: float = Field(gt=0, le=20, description="Delay beyond the calibrated force_lag_ms.")
    columns: ClassVar[Constants] = {"delay_ms": hidden.DELAY_MS}


class Backlash(HiddenEffect):
    """A play between encoder and tip, which the flanks push along."""

    effect: Literal["backlash"] = Field(description="A play between encoder and tip.")
    gap: Position = Field(gt=0, description="Width of the play.")
    columns: ClassVar[Constants] = {"gap": hidden.GAP}


class PositionRipple(HiddenEffect):
    """A screw with a periodic pitch error: the tip is off by e sin(2 pi x / pitch)."""

    effect: Literal["position_ripple"] = Field(description="A screw with a periodic pitch error.")
    pitch_error: Position = Field(gt=0, description="Amplitude of the error.")
    pitch: Position = Field(gt=0, description="Travel over which the error repeats.")
    columns: ClassVar[Constants] = {"pitch_error": hidden.PITCH_ERROR, "pitch": hidden.PITCH}


class SeriesCompliance(HiddenEffect):
    """A lever that bends between encoder and tip, after a short settling time."""

    effect: Literal["series_compliance"] = Field(
        description="A lever that bends between encoder and tip."
    )
    compliance: Annotated[float, Quantity("{x}_per_{f}")] = Field(
        gt=0, description="Deflection per force of the lever."
    )
    columns: ClassVar[Constants] = {"compliance": hidden.COMPLIANCE}


HiddenEffectConfig = Annotated[
    NonlinearStiffening
    | SecondLayer
    | StressRelaxation
    | Hysteresis
    | QuadraticDamping
    | Adhesion
    | Softening
    | MullinsSoftening
    | PermanentSet
    | MovingSurface
    | CoulombFriction
    | StribeckFriction
    | ViscousFriction
    | DirectionDependentDamping
    | ToolInertia
    | ForceBias
    | ForceDrift
    | PeriodicDisturbance
    | ForceLag
    | ForceSaturation
    | Outliers
    | ChannelDelay
    | Backlash
    | PositionRipple
    | SeriesCompliance,
    Field(discriminator="effect"),
]
