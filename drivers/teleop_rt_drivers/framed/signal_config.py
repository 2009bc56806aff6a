"""Where a framed device's measured values come from, and which frames are good."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from teleop_rt.section import Force, Position, Quantity, Section

Sign = Literal[1, -1]


class StatusConfig(Section):
    """A field that tells whether the frame can be believed."""

    field: str = Field(description="Field of the frame that holds the status.")
    good: int = Field(
        0,
        description=(
            "Value of a good frame; a measured value that comes with any other is rejected."
        ),
    )


class ClockConfig(Section):
    """A field in which the device tells its own time."""

    field: str = Field(
        description="Field of the frame in which the device tells its own time, as a count."
    )
    tick_s: float = Field(
        gt=0, le=1, description="Duration of one count: 1e-6 for a stamp in microseconds."
    )
    bits: int = Field(32, ge=8, le=64, description="Bits after which the count wraps around.")


class SignalConfig(Section):
    """A measured value: which field of which source (a serial port, a CAN message)."""

    source: str = Field(
        description=(
            "Where the value comes from: a port's name (serial) or a message's name (CAN)."
        )
    )
    field: str = Field(
        description="Field of the frame, or signal of the message, that holds the value."
    )
    sign: Sign = Field(
        1,
        description=(
            "1 where the device's numbers rise towards the environment (or when the tool presses),"
            " else -1."
        ),
    )
    status: StatusConfig | None = Field(
        None,
        description=(
            "Field that says whether the frame is good; null trusts every frame that passes its "
            "checks."
        ),
    )
    clock: ClockConfig | None = Field(
        None,
        description=(
            "Field with the device's own time; a count that stands still is a frozen device. Null "
            "stamps on arrival."
        ),
    )
    timeout_ms: int = Field(
        60, ge=2, le=60_000, description="Silence after which the device counts as lost."
    )


class PositionSignal(SignalConfig):
    """The position."""

    scale: Annotated[float | None, Quantity("{x}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of position per unit of the field; needed where the field's unit is not the"
            " rig's."
        ),
    )
    offset: Position = Field(0.0, description="Position at the field's 0.")


class ForceSignal(SignalConfig):
    """The force."""

    scale: Annotated[float | None, Quantity("{f}_per_unit"), Field(gt=0)] = Field(
        None,
        description=(
            "Rig units of force per unit of the field; needed where the field's unit is not the "
            "rig's."
        ),
    )
    offset: Force = Field(0.0, description="Force at the field's 0.")


class SwitchSignal(Section):
    """A home switch: bits of a whole number in some frame."""

    source: str = Field(
        description=(
            "Where the switch comes from: a port's name (serial) or a message's name (CAN)."
        )
    )
    field: str = Field(description="Field that holds the bits of the switch, a whole number.")
    mask: int = Field(
        1, ge=1, description="Bits of the switch; it is closed where any of them is set."
    )
    inverted: bool = Field(
        default=False, description="Whether set bits mean an open switch instead."
    )
