"""The schema of trials and rigs: bounds beside each field, unknown keys refused.

Keys carry their unit. A rig declares its units of position and force; a key whose unit depends
on them ends in the rig's own (`position_max_m` on a linear rig, `position_max_rad` on a rotary
one). In Python the same field has no suffix (`position_max`) and is in the rig's unit.
`yaml_file.py` reads files and `config_loader.py` turns them into these models.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    SerializeAsAny,
    ValidationInfo,
    model_validator,
)

PositionUnit = Literal["m", "rad"]
ForceUnit = Literal["N", "Nm"]
ModelId = Literal[
    "mass", "kelvin-voigt", "kelvin-voigt-unilateral", "mass-spring-damper", "hunt-crossley"
]
RegressionId = Literal["direct", "algebraic"]
Mode = Literal["model-mediated", "direct", "tdpa", "four-channel"]
SolverId = Literal["rls", "sprls", "ni-sprls", "gn-vff-rls", "iec"]


class Quantity:
    """Annotation of a field whose key ends in the rig's unit; {x} and {f} stand for the units."""

    def __init__(self, suffix: str) -> None:
        self.suffix = suffix

    def key(self, name: str, units: Units) -> str:
        """Return the YAML key of the field `name` on a rig with these units."""
        return f"{name}_{units.fill(self.suffix)}"


Position = Annotated[float, Quantity("{x}")]
Velocity = Annotated[float, Quantity("{x}_per_s")]
Acceleration = Annotated[float, Quantity("{x}_per_s2")]
Force = Annotated[float, Quantity("{f}")]
ForceRate = Annotated[float, Quantity("{f}_per_s")]
Stiffness = Annotated[float, Quantity("{f}_per_{x}")]
Damping = Annotated[float, Quantity("{f}_s_per_{x}")]
Mass = Annotated[float, Quantity("{f}_s2_per_{x}")]


class Units(BaseModel):
    """The rig's units of position and force: m and N, or rad and Nm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    position: PositionUnit
    force: ForceUnit

    @model_validator(mode="after")
    def _belong_together(self) -> Units:
        if (self.position == "rad") != (self.force == "Nm"):
            raise ValueError("position in m goes with force in N, position in rad with force in Nm")
        return self

    def fill(self, template: str) -> str:
        """Return `template` with {x} and {f} replaced by the units."""
        return template.replace("{x}", self.position).replace("{f}", self.force)


class MissingUnit:
    """Stands in for a value whose key was written without its unit; no field accepts it."""

    def __init__(self, key: str) -> None:
        self.key = key


class Section(BaseModel):
    """A part of a config file: unknown keys are refused, numbers are finite, values frozen.

    Values are taken as they are written (strict): text is no number, and `on` is no boolean.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """Return the fields whose key ends in a unit of the rig."""
        found = {}
        for name, field in cls.model_fields.items():
            for item in field.metadata:
                if isinstance(item, Quantity):
                    found[name] = item
        return found

    @model_validator(mode="before")
    @classmethod
    def _strip_units(cls, data: Any, info: ValidationInfo) -> Any:
        """Rename `position_max_m` to `position_max`; a wrong unit stays, and is refused."""
        units = (info.context or {}).get("units")
        if units is None or not isinstance(data, dict):
            return data
        renamed = dict(data)
        for name, quantity in cls.quantities().items():
            key = quantity.key(name, units)
            if name in renamed:
                renamed[name] = MissingUnit(key)
            elif key in renamed:
                renamed[name] = renamed.pop(key)
        return renamed


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
    cpu: int | None = Field(None, ge=0, description="the core that the loop is pinned to")
    awake: bool = Field(default=False, description="keep the processor out of deep sleep")
    spin_us: float = Field(0, ge=0, le=200, description="wait without sleep before a deadline")


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
    axis: SerializeAsAny[AxisConfig]

    @property
    def period_ns(self) -> int:
        """Length of one cycle."""
        return round(1e9 / self.rate_hz)


class ProfileOperator(Section):
    """The report's profile: approach until the wall is felt, then a sinusoid in contact."""

    kind: Literal["profile"]
    start: Position = 0.0
    approach_speed: Velocity = Field(gt=0)
    mean: Position = Field(gt=0, description="mean penetration")
    amplitude: Position = Field(gt=0)
    frequency_hz: float = Field(gt=0, le=50)
    felt_force: Force = Field(gt=0, description="the operator knows the wall from this force on")
    lift_off_every_s: float = Field(4.0, gt=0)
    lift_off_height: Position = Field(gt=0, description="how far above the surface to lift")

    @model_validator(mode="after")
    def _stays_in_contact(self) -> ProfileOperator:
        if self.amplitude >= self.mean:
            raise ValueError("amplitude must be below mean, or every cycle would leave contact")
        return self


class RecordedOperator(Section):
    """The motion of a recording's own master, played again."""

    kind: Literal["recorded"]
    file: str
    time_column: str = "t_s"
    position_column: str
    position_scale: float = Field(1.0, description="rig unit per unit of the column, with sign")


class HandOperator(Section):
    """A simulated hand that holds the device and pushes towards what it intends."""

    kind: Literal["hand"]
    intention: ProfileOperator
    mass: Mass = Field(gt=0, description="of hand and device")
    stiffness: Stiffness = Field(gt=0)
    damping: Damping = Field(ge=0)
    tremor: Force = Field(0.0, ge=0, description="standard deviation")
    tremor_hz: float = Field(9.0, gt=0, le=20)
    reaction_ms: float = Field(150.0, ge=0, le=1000, description="until it knows what it feels")
    grip_every_s: float = Field(2.0, gt=0, description="time between changes of grip")
    grip_change: float = Field(0.0, ge=0, lt=1, description="largest relative change of grip")


class DeviceOperator(Section):
    """A real device in the operator's hand, through the same drivers as the slave's axis.

    Its units are the rig's. `hand` simulates the device's bytes and the hand that holds it.
    """

    kind: Literal["device"]
    rig: RigConfig = Field(description="in the file also: its path, relative to the trial")
    hand: HandOperator | None = None


OperatorConfig = Annotated[
    ProfileOperator | RecordedOperator | HandOperator | DeviceOperator,
    Field(discriminator="kind"),
]


class ContactConfig(Section):
    """Detection of contact by force with hysteresis, and of the surface."""

    onset_force: Force = Field(gt=0)
    release_force: Force = Field(gt=0)
    onset_samples: int = Field(3, ge=1, le=100)
    release_samples: int = Field(5, ge=1, le=1000)
    free_air_ms: float = Field(
        20.0, ge=1, description="time below release_force before an onset is believed to be one"
    )

    @model_validator(mode="after")
    def _hysteresis(self) -> ContactConfig:
        if self.release_force >= self.onset_force:
            raise ValueError("release_force must be below onset_force")
        return self


class Differentiator(Section):
    """How velocity and acceleration are had from position."""

    kind: Literal["svf", "kalman", "foaw"] = "svf"
    cutoff_hz: float = Field(60.0, gt=0, le=1000)


class EstimationConfig(Section):
    """Which estimators run: every model x regression x solver that the page allows."""

    models: tuple[ModelId, ...] = Field(
        ("kelvin-voigt", "mass-spring-damper", "hunt-crossley"), min_length=1
    )
    regressions: tuple[RegressionId, ...] = Field(("direct",), min_length=1)
    solvers: tuple[SolverId, ...] = Field(("rls",), min_length=1)
    differentiator: Differentiator = Differentiator()
    forgetting_factor: float = Field(1.0, gt=0.9, le=1)


class SlaveConfig(Section):
    """How the slave guards itself and the environment."""

    force_cap: Force = Field(gt=0, description="no contact is pressed harder than this")
    retreat_speed: Velocity = Field(gt=0)
    hold_after_ms: float = Field(100, gt=0, description="silence of the master before holding")
    retreat_after_ms: float = Field(500, gt=0, description="silence before retreating")

    @model_validator(mode="after")
    def _holds_first(self) -> SlaveConfig:
        if self.retreat_after_ms < self.hold_after_ms:
            raise ValueError("retreat_after_ms must not be below hold_after_ms")
        return self


class MasterConfig(Section):
    """The operator's side: its device, and how force is rendered."""

    rate_hz: int = Field(1000, ge=100, le=4000)
    force_max: Force = Field(gt=0)
    force_step: Force = Field(gt=0, description="largest step of force per tick by a new model")
    device_damping: Damping = Field(ge=0, description="the device's own physical damping")
    device_velocity: Literal["measured", "difference"] = Field(
        "measured", description="by the device, or from its position; for the passivity bound"
    )
    device_cutoff_hz: float = Field(
        0.0, ge=0, le=1000, description="low-pass on the device's velocity; 0 for none"
    )
    device_delay_ms: float = Field(
        0.0, ge=0, le=20, description="from a motion of the device to the force that answers it"
    )
    offset_speed: Velocity = Field(
        gt=0, description="how fast the offset is removed out of contact"
    )
    position_scale: float = Field(1.0, gt=0, le=100, description="slave's motion per hand's")
    force_scale: float = Field(1.0, gt=0, le=100, description="hand's force per slave's")
    on_violation: Literal["reduce", "refuse"] = Field(
        "reduce", description="what to do with a wall that the device cannot render passively"
    )
    tank_power_mW: float = Field(5.0, ge=0, description="energy allowance of a hand at rest")
    tank_capacity_mJ: float = Field(50.0, gt=0)
    freeze_after_ms: float = Field(500, gt=0)
    declutch_after_ms: float = Field(2000, gt=0)
    fade_ms: float = Field(200, gt=0)

    @model_validator(mode="after")
    def _freezes_first(self) -> MasterConfig:
        if self.declutch_after_ms <= self.freeze_after_ms:
            raise ValueError("declutch_after_ms must be above freeze_after_ms")
        return self


class CouplingConfig(Section):
    """Gains of the modes that couple hand and slave without a model (`mode`)."""

    force_gain: float = Field(1.0, ge=0, le=1, description="share of the force reflected")
    stiffness: Stiffness = Field(500.0, ge=0, description="four-channel: position controllers")
    damping: Damping = Field(5.0, ge=0, description="four-channel: position controllers")
    slave_damping: Damping = Field(400.0, gt=0, description="four-channel: of the slave's tool")
    slave_mass: Mass = Field(2.0, gt=0, description="four-channel: virtual mass of the slave")
    local_gain: float = Field(0.5, ge=0, le=10, description="four-channel: local force controllers")
    control_damping_max: Damping = Field(
        30.0, gt=0, description="tdpa: most damping that the master's controller adds"
    )
    drift_speed: Velocity = Field(0.05, ge=0, description="tdpa: how fast drift is taken back")
    reserve_mJ: float = Field(25.0, ge=0, description="tdpa: energy that each end may lend")
    reserve_mW: float = Field(2.5, ge=0, description="tdpa: what it may lend more each second")


class LinkConfig(Section):
    """The link between slave and master, and the network that is put between them."""

    host: str = Field("127.0.0.1", description="where the peer is")
    bind_host: str = Field("127.0.0.1", description="where to listen; loopback unless said")
    slave_port: int = Field(0, ge=0, le=65535, description="0 takes a free one")
    master_port: int = Field(0, ge=0, le=65535, description="0 takes a free one")
    key_file: str | None = None
    keep_alive_ms: float = Field(50, ge=1, le=1000)
    model_deadband: Literal["noise", "just-noticeable", "none"] = Field(
        "noise", description="which change of force by a new model is worth sending it at once"
    )
    just_noticeable_share: float = Field(
        0.1, gt=0, lt=1, description="change of force that a hand can tell, as a share of it"
    )
    round_trip_ms: float = Field(0, ge=0, le=10000)
    jitter_ms: float = Field(0, ge=0, le=1000)
    loss: float = Field(0, ge=0, lt=1)
    duplicate: float = Field(0, ge=0, lt=1)
    reorder: float = Field(0, ge=0, lt=1)
    loss_burst: float = Field(1, ge=1, le=1000, description="mean length of a burst of losses")
    blackouts_s: tuple[tuple[float, float], ...] = Field(
        (), description="intervals without any packet, from the start of the trial"
    )


class FittedEffectConfig(Section):
    """An effect that diagnosis named, as it wrote it: amplitude and shape parameters in SI."""

    name: str
    law: str = ""
    belongs_to: Literal["environment", "rig"] | None = None
    compensation: str | None = None
    parameters: dict[str, float | None] = {}


class ExtendedBaseConfig(Section):
    """The model that the effects were fitted beside."""

    model: str
    parameters: dict[str, float | None] = {}


class ExtendedModelConfig(Section):
    """An extended model as `diagnose --out` writes it (model.yaml)."""

    base: ExtendedBaseConfig
    effects: tuple[FittedEffectConfig, ...]


class PlantConfig(Section):
    """What a simulated plant is told; its driver extends it. Nobody else may look inside."""


class TrialConfig(Section):
    """A trial: one rig, one operator, one link, for some time."""

    format: int = Field(1, description="of this file")
    name: str = Field(min_length=1, pattern=r"^[A-Za-z0-9_-]+$")
    rig: RigConfig = Field(description="in the file also: its path, relative to the trial")
    duration_s: float = Field(gt=0, le=86400)
    seed: int = Field(0, ge=0)
    mode: Mode = Field(
        "model-mediated", description="what the operator feels; the others are baselines"
    )
    coupling: CouplingConfig = CouplingConfig()
    operator: OperatorConfig
    contact: ContactConfig
    estimation: EstimationConfig = EstimationConfig()
    extended_model: ExtendedModelConfig | None = Field(
        None, description="in the file also: its path, relative to the trial"
    )
    effects_file: str | None = Field(
        None, description="Python file with effects of your own, relative to the trial"
    )
    slave: SlaveConfig
    master: MasterConfig
    link: LinkConfig = LinkConfig()
    plant: SerializeAsAny[PlantConfig] | None = None

    @model_validator(mode="after")
    def _possible(self) -> TrialConfig:
        problems = [*self._forces_out_of_order(), *self._motion_out_of_range()]
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _forces_out_of_order(self) -> list[str]:
        """Tell where noise, onset of contact, force cap and limit do not follow one another."""
        problems = []
        cap, limit = self.slave.force_cap, self.rig.limits.force_max
        onset, noise = self.contact.onset_force, self.rig.sensors.force_noise
        if cap > limit:
            problems.append(f"slave.force_cap {cap} is above the rig's limits.force_max {limit}")
        if onset >= cap:
            problems.append(f"contact.onset_force {onset} is not below slave.force_cap {cap}")
        if onset < 3 * noise:
            problems.append(
                f"contact.onset_force {onset} is below three times the rig's"
                f" sensors.force_noise {noise}: noise would be taken for contact"
            )
        return problems

    def _motion_out_of_range(self) -> list[str]:
        """Tell where a profile cannot fit into the rig's range, wherever the surface lies."""
        operator, limits = self.operator, self.rig.limits
        profile = operator.intention if isinstance(operator, HandOperator) else operator
        if not isinstance(profile, ProfileOperator):
            return []
        problems = []
        scale = self.master.position_scale
        deepest = scale * (profile.mean + profile.amplitude)
        room = limits.position_max - limits.position_min
        if deepest > room:
            problems.append(
                f"the operator's mean and amplitude make {deepest:g} of penetration, and the rig's"
                f" limits leave a range of {room:g}"
            )
        start = scale * profile.start
        if not limits.position_min <= start <= limits.position_max:
            problems.append(
                f"the operator's start {start:g} is outside of the rig's limits"
                f" {limits.position_min:g} to {limits.position_max:g}"
            )
        return problems
