"""The schema of rigs: units, rate, sensors, limits, zeros, and how the devices are reached."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, SerializeAsAny, model_validator

from teleop_rt.config_supervision import SupervisionConfig, UnsafeWord
from teleop_rt.section import (
    Acceleration,
    Damping,
    Force,
    ForceRate,
    Mass,
    Position,
    Quantity,
    Section,
    Units,
    Velocity,
)


class AxisConfig(Section):
    """The common section of all drivers; each driver extends it with its own keys."""

    driver: str = Field(
        description=(
            "Driver that reaches the devices; it decides which other keys this section has."
        )
    )

    @property
    def executes(self) -> bool:
        """Whether commands are executed, so that what is measured can be compared with them."""
        return True

    @property
    def paired(self) -> bool:
        """Whether position and force are measured at different times, to be paired by stamps."""
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
            "series; needed where the force sensor is slower than the loop, for the force runs "
            "ahead of it. Null where it is not known."
        ),
    )

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.position_min >= self.position_max:
            raise ValueError("position_min must be below position_max")
        return self


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
    """How the rig finds its zeros before it follows anybody; what is left out is trusted."""

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
            "Time before each deadline that is spent waiting without sleep; 50 removes most of the"
            " wake latency, at the cost of that share of a core."
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


EnablingSwitch = Literal["none", "switch", "key"]


class EnablingKey(Section):
    """A key of an input device that must be held, read from the kernel's own events."""

    device: str = Field(
        min_length=1,
        description="Input device, a path below /dev/input/by-id.",
    )
    code: int = Field(
        57, ge=1, le=767, description="Code of the key (linux/input-event-codes.h); 57 is space."
    )


class DeviceBody(Section):
    """Physical properties of an operator's device, by its data sheet or a calibration.

    The passivity bound relies on damping and latency; a simulated device has these properties.
    """

    mass: Mass = Field(gt=0, description="Moving mass (or inertia) that the hand feels.")
    damping: Damping = Field(
        ge=0, description="Viscous friction, at its least over the travel; do not overstate it."
    )
    coulomb_friction: Force = Field(0.0, ge=0, description="Dry friction; no bound relies on it.")
    end_stop_min: Position = Field(description="Lower mechanical end of the travel.")
    end_stop_max: Position = Field(description="Upper mechanical end of the travel.")
    force_bandwidth_hz: float = Field(
        1000.0, ge=20, le=20_000, description="Bandwidth of the drive's force, first order."
    )
    force_latency_ms: float = Field(
        0.0, ge=0, le=20, description="Time from a command that has arrived to its force."
    )
    position_latency_ms: float = Field(
        0.0, ge=0, le=20, description="Age of a position when the device latches it."
    )
    enabling: EnablingSwitch = Field(
        "none",
        description=(
            "Condition for any force on the device: its digital input is closed (switch), a key is "
            "held (key), or no condition (none), which is shown in red."
        ),
    )
    enabling_key: EnablingKey | None = Field(
        None, description="With enabling: key, the input device and its key."
    )

    @model_validator(mode="after")
    def _ordered(self) -> DeviceBody:
        if self.end_stop_min >= self.end_stop_max:
            raise ValueError("end_stop_min must be below end_stop_max")
        if (self.enabling == "key") != (self.enabling_key is not None):
            raise ValueError("enabling_key is only for enabling: key")
        return self

    @property
    def latency_s(self) -> float:
        """Return the device's own share of the latency, its bandwidth counted as a delay."""
        lag_s = 1 / (2 * math.pi * self.force_bandwidth_hz)
        return 1e-3 * (self.force_latency_ms + self.position_latency_ms) + lag_s


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
        ge=100, le=4000, description="Rate of the slave's control loop; 1000 is usual."
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
    device: DeviceBody | None = Field(
        None, description="Physical properties of an operator's device; null for a slave's rig."
    )
    axis: SerializeAsAny[AxisConfig] = Field(
        description="Driver and devices: how encoder, force sensor and drive are reached."
    )

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
