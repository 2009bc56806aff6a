"""The schema of trials: bounds beside each field, unknown keys refused.

Rigs are in `config_rig.py`, operators in `config_operator.py`. `yaml_file.py` reads files and
`config_loader.py` turns them into these models.
"""

from __future__ import annotations

from typing import Literal

from pydantic import Field, SerializeAsAny, model_validator

from teleop_rt.config_operator import HandOperator, OperatorConfig, ProfileOperator
from teleop_rt.config_rig import RigConfig
from teleop_rt.section import Damping, Force, Mass, Section, Stiffness, Velocity

ModelId = Literal[
    "mass", "kelvin-voigt", "kelvin-voigt-unilateral", "mass-spring-damper", "hunt-crossley"
]
RegressionId = Literal["direct", "algebraic"]
Mode = Literal["model-mediated", "direct", "tdpa", "four-channel"]
SolverId = Literal["rls", "sprls", "ni-sprls", "gn-vff-rls", "iec"]


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
        100.0, gt=0, description="tdpa: most damping that the master's controller adds"
    )
    drift_speed: Velocity = Field(0.05, ge=0, description="tdpa: how fast drift is taken back")
    reserve_mJ: float = Field(25.0, ge=0, description="tdpa: energy that each end may lend")
    reserve_mW: float = Field(2.5, ge=0, description="tdpa: what it may lend more each second")


class LinkConfig(Section):
    """The link between slave and master, and the network that is put between them."""

    host: str = Field("127.0.0.1", description="where the peer is")
    bind_host: str = Field("127.0.0.1", description="where to listen; loopback unless said")
    slave_port: int = Field(
        0, ge=0, le=65535, description="0 takes a free one, in a run; sides started apart need one"
    )
    master_port: int = Field(0, ge=0, le=65535, description="0 takes a free one")
    key_file: str | None = None
    accepted_rates_hz: tuple[int, int] = Field(
        (100, 4000), description="lowest and highest rate of a peer; one outside gets no session"
    )
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

    @model_validator(mode="after")
    def _rates_in_order(self) -> LinkConfig:
        lowest, highest = self.accepted_rates_hz
        if not 0 < lowest <= highest:
            raise ValueError("accepted_rates_hz are two positive rates, the lowest first")
        return self


class FittedEffectConfig(Section):
    """An effect that diagnosis named, as it wrote it: amplitude and shape parameters in SI."""

    name: str
    law: str = ""
    belongs_to: Literal["environment", "rig"] | None = None
    compensation: str | None = None
    parameters: dict[str, float | None] = Field({})


class ExtendedBaseConfig(Section):
    """The model that the effects were fitted beside."""

    model: str
    parameters: dict[str, float | None] = Field({})


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
        problems = [
            *self._forces_out_of_order(),
            *self._motion_out_of_range(),
            *self._sampled_too_slowly(),
        ]
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

    def _sampled_too_slowly(self) -> list[str]:
        """Tell where a derivative's bandwidth is more than the rate of the loop has room for."""
        cutoff, rate = self.estimation.differentiator.cutoff_hz, self.rig.rate_hz
        if cutoff < rate / 3:
            return []
        problem = (
            f"estimation.differentiator.cutoff_hz {cutoff:g} is not below a third of the rig's"
            f" rate_hz {rate:g}: take less than {rate / 3:.3g} Hz, or a higher rate"
        )
        return [problem]

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
