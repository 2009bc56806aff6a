"""The zeros of a rig: taring of the force and homing of the position."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config.section import (
    Force,
    ForceRate,
    Position,
    Quantity,
    Section,
    Velocity,
)


class TareConfig(Section):
    """The force sensor's zero, found at rest in free air before the axis can be armed."""

    duration_ms: float = Field(
        500,
        ge=20,
        le=10_000,
        description=(
            "Time at rest in free air over which the force is averaged; 300 to 500 ms is usual."
        ),
    )
    offset_max: Force = Field(
        gt=0,
        description=(
            "Largest mean that is taken for an offset; a larger one is taken for a contact, and "
            "the tare is refused."
        ),
    )
    noise_max: Force = Field(
        gt=0,
        description=(
            "Largest standard deviation about a straight line that is accepted as free air."
        ),
    )
    drift_max: ForceRate = Field(
        gt=0, description="Largest slope of the force over the tare that is accepted as free air."
    )


class HomingConfig(Section):
    """The position's zero, found under power: to a switch, or by touching something fixed.

    The tool goes in `direction` until it finds it, draws back, comes again slowly, takes the
    place for `position`, and draws back.
    """

    to: Literal["switch", "touch"] = Field(
        description=(
            "Reference that the tool approaches: the home switch, or a fixed object to touch."
        )
    )
    position: Position = Field(
        description="True position of the switch or the touched object; the zero is set from it."
    )
    direction: Literal[1, -1] = Field(
        -1,
        description=(
            "Sign of the motion of the search: -1 away from the environment, 1 towards it."
        ),
    )
    search: Position = Field(
        gt=0,
        description="Longest travel of the search; homing fails if nothing is found within it.",
    )
    back_off: Position = Field(
        gt=0,
        description=(
            "Travel by which the tool draws back after finding it; homing also fails where the "
            "tool lags behind its command by more."
        ),
    )
    speed: Velocity = Field(
        gt=0, description="Speed of the search and of drawing back; not above limits.velocity_max."
    )
    slow_speed: Velocity = Field(
        gt=0,
        description=(
            "Speed of the second approach, whose finding decides; a tenth of speed is usual."
        ),
    )
    touch_force: Annotated[
        float | None,
        Quantity("{f}"),
        Field(gt=0, description="Force at which a touch is detected."),
    ] = Field(
        None,
        description=(
            "Force at which a touch is detected; above tare.offset_max, and only with homing by "
            "touch."
        ),
    )

    @model_validator(mode="after")
    def _slower(self) -> HomingConfig:
        if self.slow_speed > self.speed:
            raise ValueError("slow_speed must not be above speed")
        if (self.to == "touch") != (self.touch_force is not None):
            raise ValueError("touch_force is only for homing by touch")
        return self


class ReferenceConfig(Section):
    """How the rig finds its zeros before it follows anybody; a zero that is left out is trusted."""

    tare: TareConfig | None = Field(
        None,
        description=(
            "How the force sensor's zero is found before arming; without it the sensor's own zero "
            "is trusted."
        ),
    )
    homing: HomingConfig | None = Field(
        None,
        description=(
            "How the position's zero is found under power; without it the encoder's own zero is "
            "trusted."
        ),
    )

    @model_validator(mode="after")
    def _touch_is_felt(self) -> ReferenceConfig:
        touch = None if self.homing is None else self.homing.touch_force
        if touch is not None and (self.tare is None or touch <= self.tare.offset_max):
            raise ValueError("homing by touch needs tare, and touch_force above tare's offset_max")
        return self
