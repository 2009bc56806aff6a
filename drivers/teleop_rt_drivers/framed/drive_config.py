"""The drive of a serial or raw CAN rig: its frames, words and watchdog."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from teleop_rt.config.section import Force, Position, Quantity, Section
from teleop_rt_drivers.framed.signal_config import RawValue, Sign
from teleop_rt_drivers.quantity import DriveZero


class ControlWords(Section):
    """Values for the drive's control field."""

    off: RawValue = Field(0, description="Value that takes power away from the drive.")
    follow: RawValue = Field(1, description="Value that makes the drive follow its target.")
    stop: RawValue = Field(2, description="Value that makes the drive come to rest under power.")


class DriveStates(Section):
    """Values of the drive's state field."""

    following: RawValue = Field(
        1, description="Value by which the drive says that it follows its target."
    )
    stopping: RawValue = Field(
        2, description="Value by which the drive says that it comes to rest."
    )
    fault: RawValue = Field(3, description="Value by which the drive reports a fault.")


class FramedDriveConfig(Section):
    """A drive that takes positions: two frames, and the meaning of their fields."""

    command: str = Field(
        description="Where commands go: a port's name (serial) or a message's name (CAN)."
    )
    target: str = Field("target", description="Field of the command that takes the target.")
    control: str = Field(
        "control", description="Field of the command that takes the control value."
    )
    answer: str = Field(
        description="Where answers come from: a port's name (serial) or a message's name (CAN)."
    )
    actual: str = Field("actual", description="Field of the answer with the actual value.")
    state: str = Field("state", description="Field of the answer with the drive's state.")
    scale: Annotated[float | None, Quantity("{x}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of position per unit of target and actual; needed where their unit is not "
            "the rig's."
        ),
    )
    sign: Sign = Field(
        1, description="1 where the drive's numbers rise towards the environment, else -1."
    )
    offset: Position = Field(0.0, description="Position at the drive's 0.")
    zero: DriveZero = Field(
        "encoder",
        description=(
            "Where the drive counts from: as the encoder does (encoder), or from anywhere "
            "(unknown), then it is aligned with the encoder when power comes on."
        ),
    )
    controls: ControlWords = Field(ControlWords(), description="Values of the control field.")
    states: DriveStates = Field(DriveStates(), description="Values of the state field.")
    timeout_ms: int = Field(
        60,
        ge=2,
        le=60_000,
        description="Silence of the drive's answers after which it counts as lost.",
    )
    watchdog_ms: int | None = Field(
        None,
        ge=1,
        le=60_000,
        description=(
            "Silence of commands after which the drive stops by itself, as its manual says; "
            "null where that is not known."
        ),
    )


class ForceDriveConfig(FramedDriveConfig):
    """A drive that takes forces: target and actual are forces, 0 until it is ordered to follow."""

    scale: Annotated[float | None, Quantity("{f}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of force per unit of target and actual; needed where their unit is not the "
            "rig's."
        ),
    )
    offset: Force = Field(0.0, description="Force at the drive's 0.")
    zero: Literal["encoder"] = Field(
        "encoder", description="Always encoder: a force has no place that could be unknown."
    )
