"""How a rig's loop is scheduled, how it answers a late tick, and how it is recorded."""

from __future__ import annotations

from pydantic import Field, model_validator

from teleop_rt.config.section import (
    Section,
)


class LateConfig(Section):
    """Reaction to a stalled loop, during which the drive follows its last command.

    The defaults are for hardware: libfranka gives up after 20 lost packets of 1 ms.
    """

    hold_ms: float = Field(
        5.0,
        gt=0,
        le=10_000,
        description="Stall of the loop from which the axis holds for the tick after it.",
    )
    stop_ms: float = Field(
        20.0,
        gt=0,
        le=10_000,
        description=(
            "Stall of the loop, or silence of the sensors, from which the axis stops; not above "
            "the drive's own watchdog."
        ),
    )
    stop_share: float = Field(
        0.2,
        gt=0,
        le=1,
        description="Share of a second's ticks that, late, stop the axis; 1 never does.",
    )

    @model_validator(mode="after")
    def _holds_first(self) -> LateConfig:
        if self.hold_ms > self.stop_ms:
            raise ValueError(f"hold_ms {self.hold_ms:g} must not be above stop_ms {self.stop_ms:g}")
        return self


class RealtimeConfig(Section):
    """Privileges that the slave's loop requests; it reports refused ones and runs without."""

    priority: int = Field(
        60,
        ge=1,
        le=98,
        description=(
            "SCHED_FIFO priority that the slave's loop asks for; interrupts usually have 50."
        ),
    )
    cpu: int | None = Field(
        None,
        ge=0,
        le=8191,
        description=(
            "Processor core that the loop is pinned to and helper processes avoid; null pins "
            "nothing."
        ),
    )
    awake: bool = Field(
        default=False,
        description=(
            "Whether to keep the processor out of deep sleep (/dev/cpu_dma_latency): shorter "
            "wake-ups, more heat."
        ),
    )
    spin_us: float = Field(
        0,
        ge=0,
        le=200,
        description=(
            "Time before each deadline that is spent waiting without sleep; 50 removes the wake"
            " latency that the loop's own lead leaves, at the cost of that share of a core."
        ),
    )
    late: LateConfig = Field(
        LateConfig(), description="Stalls of the loop from which the axis holds or stops."
    )


class RecordingConfig(Section):
    """How a recording is cut into parts, and how much of it is kept; the parts are read as one."""

    part_MB: float = Field(
        250.0,
        ge=1,
        le=1e6,
        description="Size at which a part of the recording is closed and the next one begins.",
    )
    part_s: float = Field(
        3600.0,
        ge=1,
        le=1e7,
        description="Age at which a part of the recording is closed and the next one begins.",
    )
    kept_MB: float = Field(
        20_000.0,
        ge=1,
        le=1e9,
        description="Size of all parts together beyond which the oldest are removed.",
    )
    kept_parts: int | None = Field(
        None,
        ge=2,
        le=1_000_000,
        description=(
            "Number of parts beyond which the oldest are removed; null limits the size alone."
        ),
    )
