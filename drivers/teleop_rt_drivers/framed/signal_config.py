"""Sources of a framed device's measured values, and checks of their frames."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config.section import Force, Position, Quantity, Section

Sign = Literal[1, -1]
RawValue = Annotated[int, Field(ge=-(2**63), lt=2**64)]
"""A whole number as a frame of a device may hold it."""
HELD_PERIODS = 2.5
"""Periods of a slow device for which its newest value is used: one value lost is bridged."""


class StatusConfig(Section):
    """A field that states whether the frame is valid."""

    field: str = Field(description="Field of the frame that holds the status.")
    good: RawValue = Field(
        0,
        description=(
            "Value of a good frame; a measured value that comes with any other is rejected."
        ),
    )


class ClockConfig(Section):
    """A field with the device's own time."""

    field: str = Field(description="Field of the frame with the device's own time, as a count.")
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
    rate_hz: float | None = Field(
        None,
        gt=0,
        le=100_000,
        description=(
            "Rate at which the device sends values; below the rig's rate_hz each value is held "
            "for hold_ms, and estimators take each once. Null: at least one every cycle."
        ),
    )
    hold_ms: float | None = Field(
        None,
        gt=0,
        le=60_000,
        description=(
            "Age up to which the newest value is used, of a device slower than the loop; null is "
            "2.5 periods of rate_hz: one value may be lost."
        ),
    )
    timeout_ms: int = Field(
        60, ge=2, le=60_000, description="Silence after which the device counts as lost."
    )

    def held_ms(self, loop_rate_hz: float) -> float:
        """Return how long a value is used; 0 where it must be new every cycle."""
        if self.hold_ms is not None:
            return self.hold_ms
        slow = self.rate_hz is not None and self.rate_hz < loop_rate_hz
        return HELD_PERIODS * 1e3 / self.rate_hz if slow and self.rate_hz else 0.0

    @model_validator(mode="after")
    def _held_before_lost(self) -> SignalConfig:
        period_ms = 0.0 if self.rate_hz is None else 1e3 / self.rate_hz
        hold_ms = self.hold_ms or HELD_PERIODS * period_ms
        if self.hold_ms is not None and self.hold_ms < period_ms:
            raise ValueError(
                f"hold_ms {self.hold_ms:g} is below the {period_ms:g} ms between two values of "
                f"rate_hz {self.rate_hz:g}"
            )
        if hold_ms > self.timeout_ms:
            raise ValueError(
                f"timeout_ms {self.timeout_ms} is below the {hold_ms:g} ms for which a value is "
                f"held: set it to {2 * hold_ms:.0f} or more"
            )
        return self


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
        1, ge=1, lt=2**64, description="Bits of the switch; it is closed where any of them is set."
    )
    inverted: bool = Field(
        default=False, description="Whether set bits mean an open switch instead."
    )
