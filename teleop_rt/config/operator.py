"""The schema of operators: the persons or programs that move the master."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config.device import DeviceBody
from teleop_rt.config.rig import RigConfig
from teleop_rt.config.section import Damping, Force, Mass, Position, Section, Stiffness, Velocity


class ProfileOperator(Section):
    """The report's profile: approach until the wall is felt, then a sinusoid in contact."""

    kind: Literal["profile"] = Field(
        description=(
            "An analytic motion: approach until the wall is felt, then a sinusoid in contact."
        )
    )
    start: Position = Field(0.0, description="Position of the hand at the start, in free air.")
    approach_speed: Velocity = Field(
        gt=0, description="Speed of the approach towards the wall; 0.02 to 0.1 m/s is usual."
    )
    mean: Position = Field(gt=0, description="Mean penetration of the sinusoid in contact.")
    amplitude: Position = Field(
        gt=0,
        description=(
            "Amplitude of the sinusoid in contact; below mean, or every cycle would leave contact."
        ),
    )
    frequency_hz: float = Field(
        gt=0,
        le=50,
        description="Frequency of the sinusoid in contact; 0.5 to 5 Hz is usual of a hand.",
    )
    felt_force: Force = Field(
        gt=0,
        description=(
            "Rendered force at which the operator notices the wall and begins the sinusoid."
        ),
    )
    lift_off_every_s: float = Field(
        4.0,
        gt=0,
        le=86_400,
        description=(
            "Time in contact after which the hand lifts off and approaches again; longer where the"
            " start of the sinusoid takes longer."
        ),
    )
    lift_off_height: Position = Field(
        gt=0,
        description="Height above the place where the wall was felt to which the hand lifts off.",
    )

    @model_validator(mode="after")
    def _stays_in_contact(self) -> ProfileOperator:
        if self.amplitude >= self.mean:
            raise ValueError(
                f"amplitude {self.amplitude:g} must be below mean {self.mean:g}, or every cycle"
                " would leave contact"
            )
        return self


class RecordedOperator(Section):
    """The motion of a recording's own master, played again."""

    kind: Literal["recorded"] = Field(description="The motion of a recorded hand, played again.")
    file: str = Field(
        description="CSV file with a header line; ${VARIABLE} of the environment is filled in."
    )
    time_column: str = Field("t_s", description="Header of the column with time [s].")
    position_column: str = Field(description="Header of the column with the hand's position.")
    position_scale: float = Field(
        1.0,
        ge=-1e6,
        le=1e6,
        description=(
            "Rig units of position per unit of the column, with the sign that makes motion towards"
            " the environment positive."
        ),
    )


class HandOperator(Section):
    """A simulated hand that holds the device and pushes towards its intended position."""

    kind: Literal["hand"] = Field(
        description=(
            "A simulated hand: a mass held by spring and damper that follows an intention."
        )
    )
    intention: ProfileOperator = Field(
        description="Motion that the hand intends, as if nothing pushed back."
    )
    mass: Mass = Field(
        gt=0,
        description=(
            "Mass (or inertia) of the hand, of hand and device together where it holds no device; "
            "0.1 to 2 kg is usual."
        ),
    )
    stiffness: Stiffness = Field(
        ge=0,
        description=(
            "Stiffness with which the hand is held to its intention; 300 to 3000 N/m is usual, "
            "0 for a hand that only carries its mass along."
        ),
    )
    damping: Damping = Field(ge=0, description="Damping of the hand against its intention.")
    force_max: Force = Field(
        400.0,
        gt=0,
        description=(
            "Largest force with which the hand follows its intention, without its tremor; adults"
            " pull with up to 400 N and push with up to 250 N. On a rotary device it is a torque."
        ),
    )
    tremor: Force = Field(
        0.0, ge=0, description="Standard deviation of the tremor's force; 0 for none."
    )
    tremor_hz: float = Field(
        9.0,
        gt=0,
        le=20,
        description="Centre frequency of the tremor; physiological tremor has 8 to 12 Hz.",
    )
    reaction_ms: float = Field(
        150.0,
        ge=0,
        le=1000,
        description="Time after which the intention reacts to the felt force; 150 ms is usual.",
    )
    grip_every_s: float = Field(2.0, gt=0, le=86_400, description="Time between changes of grip.")
    grip_change: float = Field(
        0.0,
        ge=0,
        lt=1,
        description=(
            "Largest relative change of stiffness and damping at a change of grip; 0 keeps them."
        ),
    )
    let_go_s: float | None = Field(
        None,
        ge=0,
        le=86_400,
        description="Time at which the hand lets go of its device; with 0 nobody ever holds it.",
    )


class DeviceOperator(Section):
    """A real device in the operator's hand, through the same drivers as the slave's axis.

    Its units are the rig's. `hand` simulates the device's bytes and the hand that holds it; the
    simulated device is that of `rig.device`, or of `plant`, where a trial is about the difference.
    """

    kind: Literal["device"] = Field(
        description="A real device in the operator's hand, or its simulated bytes."
    )
    rig: RigConfig = Field(
        description=(
            "The device's rig; in the file also its path, relative to the trial. Its units must be"
            " the slave rig's."
        )
    )
    hand: HandOperator | None = Field(
        None,
        description=(
            "Simulated hand on a simulated device; null for a real device that a person holds."
        ),
    )
    plant: DeviceBody | None = Field(
        None,
        description=(
            "True properties of the simulated device if they differ from those in its rig; null if "
            "they do not."
        ),
    )

    @model_validator(mode="after")
    def _known(self) -> DeviceOperator:
        if self.rig.device is None:
            raise ValueError(
                "rig.device is missing: mass, damping and end stops of the operator's device, from"
                " its data sheet or measured; how stiff a wall may be depends on them"
            )
        return self

    @property
    def body(self) -> DeviceBody:
        """Return the device as its own section describes it."""
        assert self.rig.device is not None  # noqa: S101 - refused above
        return self.rig.device


OperatorConfig = Annotated[
    ProfileOperator | RecordedOperator | HandOperator | DeviceOperator,
    Field(discriminator="kind"),
]
