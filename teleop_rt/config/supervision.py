"""The schema of quantities measured twice: their bounds, and words that lift a safeguard."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from teleop_rt.config.section import Damping, Force, Quantity, Section

UnsafeWord = Literal[
    "connection_loss", "watchdog", "device_timeout", "force_comparison", "position_comparison"
]
LONGEST_WATCH_MS = 200
"""Without the daemon an axis at 1.5 m/s^2 of gravity's pull moves 3 cm in this time."""


class SupervisionConfig(Section):
    """Comparisons by the slave while the drive has power; any exceeded bound stops it."""

    following_error_max: Annotated[float | None, Quantity("{x}"), Field(gt=0)] = Field(
        None,
        description=(
            "Largest distance between commanded and measured position; null takes a twentieth"
            " of the travel."
        ),
    )
    following_error_ms: float = Field(
        10, ge=1, le=1000, description="Time for which the following error must be exceeded."
    )
    repeated_position_max: Annotated[float | None, Quantity("{x}"), Field(gt=0)] = Field(
        None,
        description=(
            "Largest motion of the command during which the measured position may be one and the"
            " same number; null takes a hundredth of the travel, and at least ten steps of"
            " sensors.position_resolution."
        ),
    )
    repeated_position_ms: float = Field(
        50, ge=1, le=1000, description="Time for which that must be exceeded, by new samples."
    )
    velocity_share_max: float = Field(
        1.25,
        gt=1,
        le=2,
        description="Largest measured velocity over 10 ms, as a share of limits.velocity_max.",
    )
    position_difference_max: Annotated[float | None, Quantity("{x}"), Field(gt=0)] = Field(
        None,
        description=(
            "Largest change of the distance between encoder and the drive's own position since"
            " power came on; null takes a twentieth of the travel."
        ),
    )
    force_difference_max: Annotated[float | None, Quantity("{f}"), Field(gt=0)] = Field(
        None,
        description=(
            "Largest difference between the drive's force and the force sensor beyond load and"
            " friction, as caused by inertia; null takes three tenths of limits.force_max."
        ),
    )
    force_difference_ms: float = Field(
        100, ge=10, le=1000, description="Time constant over which that difference is averaged."
    )
    coulomb_friction: Force = Field(
        0.0,
        ge=0,
        description=(
            "Dry friction between drive and force sensor: against the motion, and of either sign"
            " below a hundredth of limits.velocity_max."
        ),
    )
    viscous_friction: Damping = Field(
        0.0, ge=0, description="Friction between drive and force sensor per unit of velocity."
    )
    load: Force = Field(
        0.0, description="Force that the drive holds in free air, such as a tool's weight."
    )
    drive_silent_ms: float = Field(
        20,
        ge=1,
        le=1000,
        description="Time for which a drive may be silent or not enabled while it follows.",
    )
    drive_enable_ms: float = Field(
        3000,
        ge=10,
        le=60_000,
        description=(
            "Time for which an armed axis waits for its drive's power: one that comes on later"
            " would move when nobody expects it."
        ),
    )
