"""The schema of the operator's side: its device, rendering, and the modes without a model."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config.section import Damping, Force, Mass, Quantity, Section, Stiffness, Velocity

Mode = Literal["model-mediated", "direct", "tdpa", "four-channel"]


class MasterConfig(Section):
    """The operator's side: its device, and how force is rendered."""

    rate_hz: int = Field(
        1000,
        ge=100,
        le=4000,
        description="Rate of the master's loop, at which force is rendered; 1000 is usual.",
    )
    force_max: Force = Field(gt=0, description="Largest force that is rendered to the hand.")
    force_step: Force = Field(
        gt=0,
        description=(
            "Largest step of the rendered force per tick that a new model may cause; smaller takes"
            " longer to adopt it. The hand's motion on a wall may change the force by more."
        ),
    )
    device_damping: Annotated[float | None, Quantity("{f}_s_per_{x}")] = Field(
        None,
        ge=0,
        description=(
            "Physical damping of an ideal device; the rig of a real device states its own, and the "
            "smaller of the two counts."
        ),
    )
    device_velocity: Literal["measured", "difference"] = Field(
        "measured",
        description=(
            "Whether an ideal device measures its velocity or it is a difference of positions; a "
            "real device's is a difference."
        ),
    )
    device_cutoff_hz: float | None = Field(
        None,
        ge=0,
        le=1000,
        description=(
            "Cut-off of the low-pass on the device's velocity, 0 for none; null takes 30 Hz for a "
            "real device. The passivity bound depends on it."
        ),
    )
    device_delay_ms: float = Field(
        0.0,
        ge=0,
        le=20,
        description=(
            "Delay from a motion of the device to the force that answers it; of a real device its "
            "driver computes it, and the larger of both counts."
        ),
    )
    offset_speed: Velocity = Field(
        gt=0,
        description=(
            "Largest speed at which the offset between hand and slave is removed out of contact: "
            "by at most half of the hand's own motion, so that a hand at rest moves nothing."
        ),
    )
    position_scale: float = Field(
        1.0,
        gt=0,
        le=100,
        description=(
            "Motion of the slave per motion of the hand; 0.1 makes the slave's motion fine."
        ),
    )
    force_scale: float = Field(
        1.0, gt=0, le=100, description="Force on the hand per force of the slave."
    )
    on_violation: Literal["reduce", "refuse"] = Field(
        "reduce",
        description=(
            "What to do with a wall that the device cannot render passively: reduce its damping "
            "and stiffness to the bound, or refuse it."
        ),
    )
    leash_mm: float = Field(
        50.0,
        gt=0,
        le=10_000,
        description=(
            "Longest lead of a real device over the slave until the first touch is known, in "
            "thousandths of the rig's unit; a brake holds the hand back from half of it on."
        ),
    )
    leash_force: Force = Field(
        40.0,
        ge=0,
        description="Largest force of the leash's brake; a hand that pushes harder slips.",
    )
    tank_power_mW: float = Field(
        5.0,
        ge=0,
        le=1e6,
        description=(
            "Power that fills the energy tank of a hand at rest; new models are paid from the tank."
        ),
    )
    tank_capacity_mJ: float = Field(
        50.0,
        gt=0,
        le=1e6,
        description=(
            "Energy that the tank holds at most, full at the start; a larger one adopts stiffer "
            "models faster."
        ),
    )
    surface_power_mW: float = Field(
        1000.0,
        ge=0,
        le=1e6,
        description=(
            "Largest power of a moving surface on the hand; a faster one is rendered more slowly."
        ),
    )
    freeze_after_ms: float = Field(
        500,
        gt=0,
        le=10_000,
        description=(
            "Silence of the slave after which the slave is asked to stay while the hand still "
            "feels the last wall."
        ),
    )
    declutch_after_ms: float = Field(
        2000,
        gt=0,
        le=60_000,
        description=(
            "Silence of the slave after which hand and slave are uncoupled and the force fades; "
            "above freeze_after_ms."
        ),
    )
    fade_ms: float = Field(
        200,
        gt=0,
        le=10_000,
        description="Time in which the rendered force fades to zero once uncoupled.",
    )

    @model_validator(mode="after")
    def _freezes_first(self) -> MasterConfig:
        if self.declutch_after_ms <= self.freeze_after_ms:
            raise ValueError("declutch_after_ms must be above freeze_after_ms")
        return self


class CouplingConfig(Section):
    """Gains of the modes that couple hand and slave without a model (`mode`)."""

    force_gain: float = Field(
        1.0,
        ge=0,
        le=1,
        description=(
            "Share of the slave's force that is reflected to the hand; below 1 is more stable and "
            "less stiff."
        ),
    )
    stiffness: Stiffness = Field(
        500.0,
        ge=0,
        description="four-channel: stiffness of the position controllers between hand and slave.",
    )
    damping: Damping = Field(
        5.0,
        ge=0,
        description="four-channel: damping of the position controllers between hand and slave.",
    )
    slave_damping: Damping = Field(
        400.0, gt=0, description="four-channel: damping of the slave's virtual tool."
    )
    slave_mass: Mass = Field(
        2.0, gt=0, description="four-channel: mass (or inertia) of the slave's virtual tool."
    )
    local_gain: float = Field(
        0.5,
        ge=0,
        le=10,
        description="four-channel: gain of the local force controllers; 0 for none.",
    )
    control_damping_max: Damping = Field(
        100.0,
        gt=0,
        description=(
            "tdpa: largest damping that the master's passivity controller adds, at most 2 m / T for"
            " a hand of mass m and a tick T."
        ),
    )
    drift_speed: Velocity = Field(
        0.05,
        ge=0,
        description=(
            "tdpa: speed at which drift between hand and slave is taken back where energy suffices."
        ),
    )
    reserve_mJ: float = Field(
        25.0,
        ge=0,
        le=1e6,
        description="tdpa: energy that each end may lend before its controller acts.",
    )
    reserve_mW: float = Field(
        2.5, ge=0, le=1e6, description="tdpa: power by which the reserve of each end grows."
    )
