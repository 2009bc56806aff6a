"""The common `axis` section of all drives with their makers' protocols."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.section import Force, Position, Quantity
from teleop_rt.config.supervision import LONGEST_WATCH_MS, UnsafeWord
from teleop_rt_drivers.actuators.codec import RADIANS_PER_UNIT, AngleUnit
from teleop_rt_drivers.bus import WATCHED_SHARE, BusConfig, stamp_deviation_s
from teleop_rt_drivers.drivetrain import FORCE_NOT_COMPARED, DrivetrainConfig
from teleop_rt_drivers.framed.config import FramedPart
from teleop_rt_drivers.framed.drive_config import (
    DriveStates,
    ForceDriveConfig,
    FramedDriveConfig,
)
from teleop_rt_drivers.framed.signal_config import ForceSignal, PositionSignal, Sign
from teleop_rt_drivers.quantity import DriveZero, FromDrive

if TYPE_CHECKING:
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.codec import Codec, LineCodec, TorqueCodec


class ActuatorPart(AxisConfig):
    """Common keys of all such drives: scale, and further measurements."""

    scale: Annotated[float, Quantity("{x}_per_unit"), Field(gt=0)] = Field(
        description=(
            "Rig units of position per unit of the drive's own: its turn, or its radian (Damiao, "
            "CyberGear, RobStride). A screw of 10 mm moves 0.01 m per turn."
        )
    )
    sign: Sign = Field(
        1, description="1 where the drive's numbers rise towards the environment, else -1."
    )
    offset: Position = Field(0.0, description="Position at the drive's 0.")
    zero: DriveZero = Field(
        "encoder",
        description=(
            "Where the drive counts from: as the encoder does (encoder; always so with position: "
            "from drive), or from anywhere (unknown), then it is aligned when power comes on."
        ),
    )
    position: FromDrive | None = Field(
        None,
        description="`from drive`: the drive's own encoder is the rig's; null: another's is.",
    )
    force: FromDrive | None = Field(
        None,
        description=(
            "`from drive`: the motor's torque is taken for the force, with all friction in "
            "between; null: another part has a force sensor."
        ),
    )
    force_offset: Force = Field(0.0, description="Force of the tool's weight at the drive.")
    drivetrain: DrivetrainConfig | None = Field(
        None,
        description=(
            "Friction and mass that `force: from drive` is freed of; null corrects nothing."
        ),
    )
    timeout_ms: int = Field(
        60, ge=2, le=60_000, description="Silence of the drive after which it counts as lost."
    )
    state_timeout_ms: int = Field(
        250,
        ge=2,
        le=60_000,
        description=(
            "Age of the drive's last report of its state (heartbeat) up to which it is believed."
        ),
    )
    watchdog_ms: int | None = Field(
        None,
        ge=1,
        le=60_000,
        description=(
            "Silence of commands after which the drive stops by itself, as it was set up; null "
            "where it has no watchdog."
        ),
    )
    answer_timeout_ms: int = Field(
        1000, ge=1, le=60_000, description="Time at start-up in which the drive must have answered."
    )

    @property
    def force_from_drive(self) -> bool:
        """Whether the force is the motor's torque."""
        return self.force is not None

    def arrival_deviation_s(self, period_s: float) -> float:
        """Return the standard deviation of an arrival's stamp [s]."""
        return WATCHED_SHARE * period_s

    @property
    def unit(self) -> AngleUnit:
        """Return the unit of the drive's own positions."""
        raise NotImplementedError

    def codec(self, rig: RigConfig) -> Codec:
        """Return the maker's protocol for this drive."""
        raise NotImplementedError

    @property
    def drive(self) -> FramedDriveConfig:
        """Return the drive as framed devices have one."""
        return FramedDriveConfig(
            command="drive",
            answer="drive",
            actual="position",
            scale=self.scale,
            sign=self.sign,
            offset=self.offset,
            zero=self.zero,
            states=DriveStates(following=1, stopping=2, fault=3),
            timeout_ms=self.timeout_ms,
            watchdog_ms=self.watchdog_ms,
        )

    @property
    def force_drive(self) -> ForceDriveConfig:
        """Return the drive of an operator's device as framed devices have one."""
        return ForceDriveConfig(
            command="drive",
            answer="drive",
            actual="torque",
            scale=self.force_per_torque,
            sign=self.sign,
            states=DriveStates(following=1, stopping=2, fault=3),
            timeout_ms=self.timeout_ms,
            watchdog_ms=self.watchdog_ms,
        )

    @property
    def force_per_torque(self) -> float:
        """Return the rig's units of force per Nm, without losses: from the travel per radian."""
        return RADIANS_PER_UNIT[self.unit] / self.scale

    def framed(self) -> FramedPart:
        """Return the part as the axis of framed devices reads it."""
        position = force = None
        if self.position is not None:
            position = PositionSignal(
                source="drive",
                field="position",
                scale=self.scale,
                sign=self.sign,
                offset=self.offset,
                timeout_ms=self.timeout_ms,
            )
        if self.force is not None:
            force = ForceSignal(
                source="drive",
                field="torque",
                scale=self.force_per_torque,
                sign=self.sign,
                offset=self.force_offset,
                timeout_ms=self.timeout_ms,
            )
        return FramedPart(
            driver=self.driver,
            position=position,
            force=force,
            drive=self.drive,
            answer_timeout_ms=self.answer_timeout_ms,
        )

    @model_validator(mode="after")
    def _one_zero(self) -> ActuatorPart:
        if self.position is not None and self.zero != "encoder":
            raise ValueError("zero: unknown cannot be combined with position: from drive")
        if self.drivetrain is not None and (self.position is None or self.force is None):
            raise ValueError("drivetrain is only for position and force: from drive")
        return self

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that the drive lacks."""
        lacks: dict[UnsafeWord, str] = {}
        if self.watchdog_ms is None or self.watchdog_ms > LONGEST_WATCH_MS:
            lacks["watchdog"] = (
                f"watchdog_ms is null or above {LONGEST_WATCH_MS}: so long the drive goes on "
                "without the daemon"
            )
        if self.position is not None:
            lacks["position_comparison"] = (
                "position is the drive's own: no second encoder is compared with it"
            )
        if self.force is not None:
            lacks["force_comparison"] = FORCE_NOT_COMPARED
        return lacks


class CanActuatorPart(ActuatorPart):
    """A drive on a CAN bus."""

    bus: BusConfig = Field(description="The CAN bus that the drive is on.")

    def arrival_deviation_s(self, period_s: float) -> float:
        """Return the standard deviation of an arrival's stamp [s]."""
        return stamp_deviation_s(self.bus, period_s)

    def codec(self, rig: RigConfig) -> TorqueCodec:
        """Return the maker's protocol for this drive, which may be asked for a torque."""
        raise NotImplementedError

    @property
    def answer_bytes(self) -> tuple[int, ...]:
        """Return the data bytes of the frames that the drive sends each cycle."""
        return (8,)


class LineActuatorPart(ActuatorPart):
    """A drive on a half-duplex serial line, which it has for itself."""

    folder: str = Field("/dev", description="Folder of the port's device; /dev on hardware.")
    device: str = Field(
        min_length=1,
        description="Device of the port: a name below folder such as ttyUSB0, or a whole path.",
    )
    baud: int = Field(ge=9600, le=6_000_000, description="Bits per second of the line.")
    usb_latency_ms: float = Field(
        1.0,
        ge=0,
        le=16,
        description=(
            "Time for which the adapter keeps bytes back: the latency timer of an FTDI chip, 16 ms "
            "unless set. `doctor` compares it."
        ),
    )
    return_delay_us: float = Field(
        0.0,
        ge=0,
        le=1000,
        description="Time that the drive waits before it answers; `doctor` compares it.",
    )

    @property
    def path(self) -> str:
        """Return the path of the port's device."""
        return self.device if self.device.startswith("/") else f"{self.folder}/{self.device}"

    def codec(self, rig: RigConfig) -> LineCodec:
        """Return the maker's protocol for this drive."""
        raise NotImplementedError
