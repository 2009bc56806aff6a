"""Effects that a trial hides in the plant: `plant.undeclared`, which only the plant may know.

Each has the name that diagnosis should find, and parameters of its own physics: the law that is
integrated here is never the one that is fitted there.
"""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from teleop_rt.section import Damping, Force, Mass, Position, Quantity, Section, Stiffness, Velocity
from teleop_rt_drivers.simulated import hidden as at

Constants = dict[str, int]
"""Where the kernel finds a field: name -> column of its constants."""


class HiddenEffect(Section):
    """What every hidden effect has."""

    columns: ClassVar[Constants] = {}

    def constants(self) -> dict[int, float]:
        """Return the effect's constants by their column."""
        return {column: float(getattr(self, name)) for name, column in self.columns.items()}


class NonlinearStiffening(HiddenEffect):
    """A foam whose cells lock: k x^2 / (L - x)."""

    effect: Literal["nonlinear_stiffening"]
    stiffness: Stiffness = Field(gt=0)
    locking_depth: Position = Field(gt=0)
    columns: ClassVar[Constants] = {"stiffness": at.FOAM, "locking_depth": at.LOCKING_DEPTH}


class SecondLayer(HiddenEffect):
    """A harder layer below, met over a graded boundary: k w ln(1 + exp((x - d)/w))."""

    effect: Literal["second_layer"]
    stiffness: Stiffness = Field(gt=0)
    depth: Position = Field(gt=0)
    blend: Position = Field(2e-4, gt=0)
    columns: ClassVar[Constants] = {
        "stiffness": at.LAYER, "depth": at.LAYER_DEPTH, "blend": at.LAYER_BLEND,
    }  # fmt: skip


class Arm(Section):
    """A spring and a dashpot in series."""

    stiffness: Stiffness = Field(gt=0)
    time_constant_s: float = Field(ge=1e-3)


class StressRelaxation(HiddenEffect):
    """Maxwell arms beside the body."""

    effect: Literal["stress_relaxation"]
    arms: tuple[Arm, ...] = Field(min_length=1, max_length=at.ARMS)

    def constants(self) -> dict[int, float]:
        """Return stiffness and time constant of each arm by their column."""
        return {
            column: value
            for i, arm in enumerate(self.arms)
            for column, value in (
                (at.ARM + i, arm.stiffness), (at.ARM_TIME + i, arm.time_constant_s)
            )
        }  # fmt: skip


class Hysteresis(HiddenEffect):
    """Bouc-Wen: z' = v/d (1 - |z|^n (beta sgn(v z) + gamma)), force F z."""

    effect: Literal["hysteresis"]
    yield_force: Force = Field(gt=0)
    yield_travel: Position = Field(gt=0)
    beta: float = Field(0.6, ge=0)
    gamma: float = Field(0.4, ge=0)
    sharpness: float = Field(1.5, ge=1)
    columns: ClassVar[Constants] = {
        "yield_force": at.YIELD_FORCE, "yield_travel": at.YIELD_TRAVEL, "beta": at.BETA,
        "gamma": at.GAMMA, "sharpness": at.SHARPNESS,
    }  # fmt: skip


class QuadraticDamping(HiddenEffect):
    """A fluid in the body: c v |v|, from the first wetted tenth of a millimetre on."""

    effect: Literal["quadratic_damping"]
    damping: Annotated[float, Quantity("{f}_s2_per_{x}2")] = Field(gt=0)
    columns: ClassVar[Constants] = {"damping": at.QUADRATIC}


class Adhesion(HiddenEffect):
    """A bond that grows in contact and pulls with exp(-(x/r)^2/2) until it breaks at 3 r."""

    effect: Literal["adhesion"]
    pull_off_force: Force = Field(gt=0)
    range: Position = Field(gt=0)
    columns: ClassVar[Constants] = {"pull_off_force": at.PULL_OFF, "range": at.BOND_RANGE}


class Softening(HiddenEffect):
    """A body that loses a share s of its stiffness with time: 1 - s t/(t + T)."""

    effect: Literal["softening"]
    share: float = Field(gt=0, lt=1)
    time_constant_s: float = Field(gt=0)
    columns: ClassVar[Constants] = {"share": at.SOFTENED, "time_constant_s": at.SOFTENING_TIME}


class MullinsSoftening(HiddenEffect):
    """Damage below the deepest past penetration m: the stiffness falls by s (1 - exp((x-m)/w))."""

    effect: Literal["mullins_softening"]
    share: float = Field(gt=0, lt=1)
    width: Position = Field(gt=0)
    columns: ClassVar[Constants] = {"share": at.DAMAGE, "width": at.DAMAGE_WIDTH}


class PermanentSet(HiddenEffect):
    """A surface that creeps down to a share of the deepest penetration."""

    effect: Literal["permanent_set"]
    share: float = Field(gt=0, lt=1)
    time_constant_s: float = Field(0.02, ge=1e-3)
    columns: ClassVar[Constants] = {"share": at.SET, "time_constant_s": at.SET_TIME}


class MovingSurface(HiddenEffect):
    """A surface that recedes, swings, or both."""

    effect: Literal["moving_surface"]
    velocity: Velocity = 0.0
    swing: Position = Field(0.0, ge=0)
    swing_hz: float = Field(0.5, gt=0, le=20)
    columns: ClassVar[Constants] = {
        "velocity": at.SURFACE_VELOCITY, "swing": at.SWING, "swing_hz": at.SWING_HZ,
    }  # fmt: skip


class CoulombFriction(HiddenEffect):
    """Dry friction of the guide as LuGre: bristles of the stiffness F / travel, and damping."""

    effect: Literal["coulomb_friction"]
    friction_force: Force = Field(gt=0)
    presliding_travel: Position = Field(1e-4, gt=0)

    def constants(self) -> dict[int, float]:
        """Return the constants of LuGre without a Stribeck peak."""
        force = self.friction_force
        return {at.KINETIC: force, at.STATIC: force, at.STRIBECK_VELOCITY: 1.0,
                at.BRISTLE: force / self.presliding_travel}  # fmt: skip


class StribeckFriction(HiddenEffect):
    """LuGre with a breakaway force above the kinetic one: it sticks and slips."""

    effect: Literal["stribeck_friction"]
    friction_force: Force = Field(gt=0)
    breakaway_force: Force = Field(gt=0)
    stribeck_velocity: Velocity = Field(gt=0)
    presliding_travel: Position = Field(1e-4, gt=0)

    def constants(self) -> dict[int, float]:
        """Return the constants of LuGre."""
        return {at.KINETIC: self.friction_force, at.STATIC: self.breakaway_force,
                at.STRIBECK_VELOCITY: self.stribeck_velocity,
                at.BRISTLE: self.friction_force / self.presliding_travel}  # fmt: skip


class ViscousFriction(HiddenEffect):
    """Lubricant in the guide."""

    effect: Literal["viscous_friction"]
    damping: Damping = Field(gt=0)
    columns: ClassVar[Constants] = {"damping": at.VISCOUS}


class DirectionDependentDamping(HiddenEffect):
    """A seal that drags more when moving in."""

    effect: Literal["direction_dependent_damping"]
    extra_forward_damping: Damping = Field(gt=0)
    columns: ClassVar[Constants] = {"extra_forward_damping": at.FORWARD}


class ToolInertia(HiddenEffect):
    """A mass between the sensor and the body."""

    effect: Literal["tool_inertia"]
    mass: Mass = Field(gt=0)
    columns: ClassVar[Constants] = {"mass": at.TOOL_MASS}


class ForceBias(HiddenEffect):
    """A sensor that was not zeroed."""

    effect: Literal["force_bias"]
    bias: Force
    columns: ClassVar[Constants] = {"bias": at.BIAS}


class ForceDrift(HiddenEffect):
    """A sensor that warms up in two stages."""

    effect: Literal["force_drift"]
    drift: Force
    time_constant_s: float = Field(gt=0.01)
    columns: ClassVar[Constants] = {"drift": at.DRIFT, "time_constant_s": at.DRIFT_TIME}


class PeriodicDisturbance(HiddenEffect):
    """Mains in the sensor's cable, with a third harmonic."""

    effect: Literal["periodic_disturbance"]
    amplitude: Force = Field(gt=0)
    frequency_hz: float = Field(gt=0, le=400)
    columns: ClassVar[Constants] = {"amplitude": at.MAINS, "frequency_hz": at.MAINS_HZ}


class ForceLag(HiddenEffect):
    """A sensor whose spring and mass make a low-pass of the second order."""

    effect: Literal["force_lag"]
    cutoff_hz: float = Field(ge=1, le=1000)
    damping_ratio: float = Field(1.0, ge=0.3, le=3)
    columns: ClassVar[Constants] = {"cutoff_hz": at.SENSOR_HZ, "damping_ratio": at.SENSOR_DAMPING}


class ForceSaturation(HiddenEffect):
    """An amplifier that runs into its supply over a soft knee."""

    effect: Literal["force_saturation"]
    level: Force = Field(gt=0)
    columns: ClassVar[Constants] = {"level": at.LEVEL}


class Outliers(HiddenEffect):
    """Sparks: a share of the samples is off by about `size`."""

    effect: Literal["outliers"]
    share: float = Field(gt=0, le=0.1)
    size: Force = Field(gt=0)
    columns: ClassVar[Constants] = {"share": at.SPARKS, "size": at.SPARK_SIZE}


class ChannelDelay(HiddenEffect):
    """A force channel that is late by more than its calibration found."""

    effect: Literal["channel_delay"]
    delay_ms: float = Field(gt=0, le=20)
    columns: ClassVar[Constants] = {"delay_ms": at.DELAY_MS}


class Backlash(HiddenEffect):
    """A play between encoder and tip, which the flanks push along."""

    effect: Literal["backlash"]
    gap: Position = Field(gt=0)
    columns: ClassVar[Constants] = {"gap": at.GAP}


class PositionRipple(HiddenEffect):
    """A screw with a periodic pitch error: the tip is off by e sin(2 pi x / pitch)."""

    effect: Literal["position_ripple"]
    pitch_error: Position = Field(gt=0)
    pitch: Position = Field(gt=0)
    columns: ClassVar[Constants] = {"pitch_error": at.PITCH_ERROR, "pitch": at.PITCH}


class SeriesCompliance(HiddenEffect):
    """A lever that bends between encoder and tip, after a short settling time."""

    effect: Literal["series_compliance"]
    compliance: Annotated[float, Quantity("{x}_per_{f}")] = Field(gt=0)
    columns: ClassVar[Constants] = {"compliance": at.COMPLIANCE}


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
