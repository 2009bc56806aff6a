"""The schema of operators: who or what moves the master."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config_rig import RigConfig
from teleop_rt.section import Damping, Force, Mass, Position, Section, Stiffness, Velocity


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
