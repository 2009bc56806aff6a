"""The `axis` sections of drives with protocols of their makers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config_rig import AxisConfig
from teleop_rt.config_supervision import LONGEST_WATCH_MS, UnsafeWord
from teleop_rt.section import Force, Position, Quantity
from teleop_rt_drivers.actuators.codec import RADIANS_PER_UNIT, AngleUnit
from teleop_rt_drivers.actuators.mit import (
    DAMIAO_RANGES,
    TYPED_RANGES,
    DamiaoCodec,
    Gains,
    MotorLimits,
    TypedCodec,
)
from teleop_rt_drivers.actuators.moteus import MoteusCodec
from teleop_rt_drivers.actuators.odrive import OdriveCodec
from teleop_rt_drivers.bus import BusConfig
from teleop_rt_drivers.framed.config import FramedPart
from teleop_rt_drivers.framed.drive_config import (
    DriveStates,
    ForceDriveConfig,
    FramedDriveConfig,
)
from teleop_rt_drivers.framed.signal_config import ForceSignal, PositionSignal, Sign
from teleop_rt_drivers.quantity import DriveZero, FromDrive

if TYPE_CHECKING:
    from teleop_rt.config_rig import RigConfig
    from teleop_rt_drivers.actuators.codec import Codec

MitMotor = Literal[
    "DM4310", "DM4310_48V", "DM4340", "DM6006", "DM8006", "DM8009",
    "cybergear", "robstride00", "robstride01", "robstride02", "robstride03", "robstride04",
]  # fmt: skip


class ActuatorPart(AxisConfig):
    """What all such drives have in common: bus, scale, and what else they measure."""

    bus: BusConfig = Field(description="The CAN bus that the drive is on.")
    scale: Annotated[float, Quantity("{x}_per_unit"), Field(gt=0)] = Field(
        description=(
            "Rig units of position per unit of the drive's own: its turn (ODrive, moteus) or its "
            "radian (Damiao, CyberGear, RobStride). A screw of 10 mm moves 0.01 m per turn."
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
    timeout_ms: int = Field(
        60, ge=2, le=60_000, description="Silence of the drive after which it counts as lost."
    )
    state_timeout_ms: int = Field(
        250,
        ge=2,
        le=60_000,
        description=(
            "Age of what the drive last said of its state (heartbeat) up to which it is believed."
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
    def unit(self) -> AngleUnit:
        """Return the unit of the drive's own positions."""
        raise NotImplementedError

    def codec(self, rig: RigConfig) -> Codec:
        """Return the maker's protocol for this drive."""
        raise NotImplementedError

    @property
    def answer_bytes(self) -> tuple[int, ...]:
        """Return the data bytes of the frames that the drive sends each cycle."""
        return (8,)

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
        """Return the rig's units of force per Nm: what is not lost moves as far per radian."""
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
            raise ValueError("zero: unknown makes no sense with position: from drive")
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
            lacks["force_comparison"] = (
                "force is the drive's own torque: no force sensor is compared with it"
            )
        return lacks


class OdrivePart(ActuatorPart):
    """An axis of an ODrive on CANSimple (firmware 0.5)."""

    driver: Literal["odrive"] = Field(description="An axis of an ODrive on CANSimple.")
    node_id: int = Field(ge=0, le=0x3F, description="The axis's node id: axis.config.can.node_id.")
    torque_constant_Nm_per_A: float = Field(
        gt=0, le=10, description="The motor's torque constant: 8.27 / KV."
    )
    current_max_A: float = Field(gt=0, le=200, description="Limit of the motor's current.")

    @property
    def unit(self) -> AngleUnit:
        """Return turns."""
        return "turn"

    @property
    def answer_bytes(self) -> tuple[int, ...]:
        """Return encoder estimates, currents and, at worst, a heartbeat."""
        return (8, 8, 8)

    def codec(self, rig: RigConfig) -> Codec:
        """Return CANSimple with the rig's top speed and the current's limit."""
        fastest = rig.limits.velocity_max / self.scale
        return OdriveCodec(self.node_id, self.torque_constant_Nm_per_A, fastest, self.current_max_A)


class MitCanPart(ActuatorPart):
    """A motor with an impedance loop of its own: Damiao, CyberGear, RobStride."""

    driver: Literal["mit_can"] = Field(
        description="A motor that takes position, velocity, stiffness, damping and torque."
    )
    motor: MitMotor = Field(
        description="Which motor: it decides the protocol, and what its numbers stand for."
    )
    motor_id: int = Field(ge=1, le=0x7F, description="The motor's own CAN id.")
    host_id: int = Field(
        ge=0,
        le=0x7FF,
        description=(
            "The id that the motor answers to: MST_ID of a Damiao (not the motor's own), host id "
            "of the others."
        ),
    )
    kp_Nm_per_rad: float = Field(
        gt=0, le=5000, description="Stiffness of the motor's own loop, in its own units."
    )
    kd_Nm_s_per_rad: float = Field(
        gt=0, le=100, description="Damping of the motor's own loop, in its own units."
    )
    torque_max_Nm: float = Field(
        gt=0, le=200, description="Limit of torque, written to motors that take one."
    )

    @property
    def unit(self) -> AngleUnit:
        """Return radians."""
        return "rad"

    def codec(self, rig: RigConfig) -> DamiaoCodec | TypedCodec:  # noqa: ARG002 - its limits are in its commands
        """Return the motor's protocol."""
        gains = Gains(self.kp_Nm_per_rad, self.kd_Nm_s_per_rad)
        if self.motor in DAMIAO_RANGES:
            return DamiaoCodec(self.motor_id, self.host_id, DAMIAO_RANGES[self.motor], gains)
        timeout_ms = self.watchdog_ms if self.motor.startswith("robstride") else None
        limits = MotorLimits(self.torque_max_Nm, timeout_ms)
        return TypedCodec(self.motor_id, self.host_id, TYPED_RANGES[self.motor], gains, limits)

    @model_validator(mode="after")
    def _fits_the_motor(self) -> MitCanPart:
        ranges = (DAMIAO_RANGES | TYPED_RANGES)[self.motor]
        if self.kp_Nm_per_rad > ranges.stiffness or self.kd_Nm_s_per_rad > ranges.damping:
            raise ValueError(
                f"{self.motor} takes kp up to {ranges.stiffness:g} and kd up to {ranges.damping:g}"
            )
        if self.motor in DAMIAO_RANGES and self.host_id == self.motor_id:
            raise ValueError("host_id (MST_ID) must not be motor_id: answers look like commands")
        if self.motor == "cybergear" and self.watchdog_ms is not None:
            raise ValueError("watchdog_ms must be null: a CyberGear has no time-out for commands")
        return self


class MoteusPart(ActuatorPart):
    """A moteus on CAN FD."""

    driver: Literal["moteus"] = Field(description="A moteus controller on CAN FD.")
    servo_id: int = Field(1, ge=1, le=0x7E, description="The controller's id.")
    torque_max_Nm: float = Field(gt=0, le=200, description="Largest torque, sent in each command.")
    watchdog_ms: int = Field(
        50, ge=2, le=1000, description="Time for which a command is valid, sent in each command."
    )

    @property
    def unit(self) -> AngleUnit:
        """Return turns."""
        return "turn"

    @property
    def answer_bytes(self) -> tuple[int, ...]:
        """Return four floats, a fault code and what stands before them, padded."""
        return (24,)

    def codec(self, rig: RigConfig) -> MoteusCodec:
        """Return the protocol with the rig's top speed, the largest torque and the watchdog."""
        fastest = rig.limits.velocity_max / self.scale
        return MoteusCodec(self.servo_id, self.torque_max_Nm, fastest, 1e-3 * self.watchdog_ms)

    @model_validator(mode="after")
    def _wide_frames(self) -> MoteusPart:
        if not self.bus.fd:
            raise ValueError("bus.fd must be true: moteus speaks CAN FD")
        return self


Actuator = OdrivePart | MitCanPart | MoteusPart
"""Every drive with a protocol of its maker."""


class ActuatorDeviceConfig(AxisConfig):
    """An operator's device that is one such drive: its position, and the torque it is asked for."""

    driver: Literal["actuator_device"] = Field(
        description="An operator's device that is a drive with a protocol of its maker."
    )
    drive: Annotated[Actuator, Field(discriminator="driver")] = Field(
        description="The drive; its position is `from drive`."
    )

    @model_validator(mode="after")
    def _measures_position(self) -> ActuatorDeviceConfig:
        if self.drive.position is None:
            raise ValueError("drive.position must be `from drive`: there is no other encoder")
        if self.drive.force is not None:
            raise ValueError("drive.force: an operator's device measures no force")
        return self

    @property
    def bus(self) -> BusConfig:
        """Return the bus of the drive."""
        return self.drive.bus
