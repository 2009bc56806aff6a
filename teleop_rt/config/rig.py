"""The schema of rigs: units, rate, sensors, limits, zeros, and how the devices are reached."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, SerializeAsAny, field_validator, model_validator

from teleop_rt.config.device import DeviceBody
from teleop_rt.config.realtime import RealtimeConfig, RecordingConfig
from teleop_rt.config.reference import ReferenceConfig
from teleop_rt.config.section import (
    Acceleration,
    Force,
    Position,
    Quantity,
    Section,
    Units,
    Velocity,
    each_once,
)
from teleop_rt.config.supervision import SupervisionConfig, UnsafeWord

LOWEST_RATE_HZ = 100
"""Of a loop; a slower one does not hold a contact."""


class AxisConfig(Section):
    """The common section of all drivers; each driver extends it with its own keys."""

    driver: str = Field(
        description=(
            "Driver that reaches the devices; it decides which other keys this section has."
        )
    )

    @property
    def executes(self) -> bool:
        """Whether commands are executed, so that measurements can be compared with them."""
        return True

    @property
    def paired(self) -> bool:
        """Whether position and force are measured at different times, to be paired by stamps."""
        return False

    def stamp_deviation_s(self, period_s: float) -> float:  # noqa: ARG002 - the loop's, of others
        """Return the standard deviation of the time between a position's stamp and a force's [s].

        0 where one SYNC latches both, or one frame has both.
        """
        return 0.0

    @property
    def force_from_drive(self) -> bool:
        """Whether the force is the drive's own, which is that of contact under power alone."""
        return False

    @property
    def sample_rate_hz(self) -> float | None:
        """Declared rate of the slowest of position and force; None where none is declared."""
        return None

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that these devices lack, each with a sentence.

        A driver that does not override this declares none.
        """
        silent = f"the driver {self.driver} does not say that its drive"
        return {
            "watchdog": f"{silent} stops without the daemon",
            "force_comparison": f"{silent} measures a force: none is compared with the sensor's",
            "position_comparison": f"{silent} measures a position: none is compared with the"
            " encoder's",
        }


class Sensors(Section):
    """Properties of the sensors, which set thresholds and noise floors."""

    position_resolution: Position = Field(
        gt=0,
        description=(
            "Smallest step of the measured position, one count of the encoder; it sets the noise "
            "floor of velocity and of the found surface."
        ),
    )
    force_noise: Force = Field(
        gt=0,
        description=(
            "Standard deviation of the force sensor's noise at rest; it sets the smallest change "
            "of force that counts. contact.onset_force must be at least three times this."
        ),
    )
    force_lag_ms: float = Field(
        0.0,
        ge=-50,
        le=50,
        description=(
            "Calibrated lag of force behind position; position is delayed by the same time before"
            " both are used. 0 to 2 ms is usual, negative where position lags."
        ),
    )
    force_lag_deviation_ms: float = Field(
        0.0,
        ge=0,
        le=10,
        description=(
            "Standard deviation of that lag by the calibration. Its error causes an error of"
            " damping, stiffness times as large, which the reported deviations include."
        ),
    )
    force_settling_ms: float = Field(
        0.0,
        ge=0,
        le=1000,
        description=(
            "Time in which the output of a converter slower than the loop settles, by its data "
            "sheet: 50 for an HX711 at 80 values/s. It averages the force over that time; the "
            "position that the force meets is averaged alike. 0: it does not average."
        ),
    )
    friction_deviation: Force = Field(
        0.0,
        ge=0,
        description=(
            "Standard deviation of the friction that is left in a force that is taken from the "
            "drive, against the motion; the reported deviations include it. 0 with a force sensor."
        ),
    )


class Limits(Section):
    """Limits that no command ever exceeds."""

    position_min: Position = Field(
        description="Lowest position that may ever be commanded, away from the environment."
    )
    position_max: Position = Field(
        description="Highest position that may ever be commanded, towards the environment."
    )
    velocity_max: Velocity = Field(
        gt=0,
        description=(
            "Highest speed of the commanded position; a measured position that moves at more than "
            "twice this is rejected."
        ),
    )
    acceleration_max: Acceleration = Field(
        gt=0, description="Highest acceleration of the commanded position."
    )
    force_max: Force = Field(
        gt=0,
        description=(
            "Measured force, of either sign, beyond which the axis stops with a fault; "
            "slave.force_cap must not be above it."
        ),
    )
    stiffness_max: Annotated[float | None, Quantity("{f}_per_{x}"), Field(gt=0)] = Field(
        None,
        description=(
            "Largest stiffness of anything that the tool meets, with that of tool and mount in "
            "series. Where nobody has been, the tool is no faster than lets it stand within "
            "slave.force_cap on such a wall. Needed where the force sensor is slower than the "
            "loop, for the force runs ahead of it. Null where it is not known."
        ),
    )

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.position_min >= self.position_max:
            raise ValueError("position_min must be below position_max")
        return self


class RigConfig(Section):
    """A rig: its units, rate, limits and how its devices are reached."""

    format: Literal[1] = Field(1, description="Version of the file format; this program reads 1.")
    name: str = Field(min_length=1, description="Name of the rig, in reports and recordings.")
    units: Units = Field(
        description=(
            "Units of position and force, which the keys of rig and trial end in: m and N on a "
            "linear rig, rad and Nm on a rotary one."
        )
    )
    rate_hz: int = Field(
        ge=LOWEST_RATE_HZ, le=4000, description="Rate of the slave's control loop; 1000 is usual."
    )
    sensors: Sensors = Field(description="Properties of the sensors.")
    limits: Limits = Field(
        description="Limits that no command exceeds, whatever the operator does."
    )
    realtime: RealtimeConfig = Field(
        RealtimeConfig(), description="Privileges that the slave's loop requests from the system."
    )
    reference: ReferenceConfig = Field(
        ReferenceConfig(), description="How the rig finds its zeros before the axis follows."
    )
    recording: RecordingConfig = Field(
        RecordingConfig(),
        description="How a recording is cut into parts, and how much of it is kept.",
    )
    supervision: SupervisionConfig = Field(
        SupervisionConfig(),
        description="Comparisons while the drive has power; any exceeded bound stops it.",
    )
    unsafe_i_know: tuple[UnsafeWord, ...] = Field(
        (),
        description=(
            "Protections that this rig lacks: connection_loss (the drive does not stop when the"
            " daemon is lost), watchdog (it stops late or after an unknown time), device_timeout"
            " (a lost device is noticed late), force_comparison and position_comparison (the drive"
            " measures no force or position of its own). Shown in red wherever the rig is."
        ),
    )
    placeholders: tuple[str, ...] = Field(
        (),
        description=(
            "Keys, dotted, whose values are still those of an example, as new-rig lists them: check"
            " and doctor warn of each. Remove a key once its value is your device's."
        ),
    )
    device: DeviceBody | None = Field(
        None, description="Physical properties of an operator's device; null for a slave's rig."
    )
    axis: SerializeAsAny[AxisConfig] = Field(
        description="Driver and devices: how encoder, force sensor and drive are reached."
    )

    _once = field_validator("unsafe_i_know", "placeholders")(each_once)

    @model_validator(mode="after")
    def _homes_within_limits(self) -> RigConfig:
        homing = self.reference.homing
        if homing is not None and homing.speed > self.limits.velocity_max:
            raise ValueError("reference.homing.speed must not be above limits.velocity_max")
        touch = None if homing is None else homing.touch_force
        if touch is not None and touch >= self.limits.force_max:
            raise ValueError("reference.homing.touch_force must be below limits.force_max")
        return self

    @model_validator(mode="after")
    def _safe_or_known(self) -> RigConfig:
        missing = {} if self.axis is None else self.axis.unsafe()
        unknown = [
            f"{sentence}: correct it, or write unsafe_i_know: [{word}]"
            for word, sentence in missing.items()
            if word not in self.unsafe_i_know
        ]
        if unknown:
            raise ValueError("; ".join(unknown))
        return self

    @property
    def unsafe(self) -> list[str]:
        """Protections that this rig lacks, in sentences."""
        return list(self.axis.unsafe().values())

    @property
    def period_ns(self) -> int:
        """Length of one cycle."""
        return round(1e9 / self.rate_hz)

    @property
    def sample_period_ns(self) -> int:
        """Time between two pairs of position and force: a cycle, or longer with slow sensors."""
        slowest_hz = self.axis.sample_rate_hz
        return (
            self.period_ns if slowest_hz is None else max(self.period_ns, round(1e9 / slowest_hz))
        )
