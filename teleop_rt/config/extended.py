"""A fitted model in a trial's file: the base and the effects that diagnosis found."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from teleop_rt.config.section import AnySize, Section


class FittedEffectConfig(Section):
    """An effect that diagnosis named, as it wrote it: amplitude and shape parameters in SI."""

    name: str = Field(description="Name of the effect, as `diagnose` names it.")
    law: str = Field("", description="Variant of the effect's equation, where it has several.")
    belongs_to: Literal["environment", "rig"] | None = Field(
        None,
        description=(
            "Whether the effect is the environment's (rendered to the hand) or the rig's "
            "(compensated); written for the reader."
        ),
    )
    compensation: str | None = Field(
        None, description="How the effect acts on-line; written for the reader."
    )
    parameters: dict[str, AnySize | None] = Field(
        {},
        description=(
            "Fitted value of each parameter in SI (or the rig's units), by name; null where it is "
            "not known."
        ),
    )


class ExtendedBaseConfig(Section):
    """The model that the effects were fitted beside."""

    model: str = Field(description="Contact model that the effects were fitted beside.")
    parameters: dict[str, AnySize | None] = Field(
        {},
        description=(
            "Fitted value of each parameter of the model, by name; null where it is not known."
        ),
    )
    clamped: bool = Field(
        default=False, description="Whether the model's force was cut off below 0."
    )
    clamped_with_effects: bool = Field(
        default=False,
        description="Whether that cut took the material effects' force together with the model's.",
    )
    clamped_without_damping: bool = Field(
        default=False, description="Whether that cut left the damping of the model, which may pull."
    )


class ExtendedModelConfig(Section):
    """An extended model as `diagnose --out` writes it (model.yaml)."""

    base: ExtendedBaseConfig = Field(description="The model that the effects were fitted beside.")
    effects: tuple[FittedEffectConfig, ...] = Field(
        description=(
            "The effects that are added to the model, in the order in which they were found."
        )
    )
