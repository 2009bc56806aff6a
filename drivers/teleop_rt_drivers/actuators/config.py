"""The `axis` sections of drives with protocols of their makers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.supervision import UnsafeWord
from teleop_rt_drivers.actuators.codec import AngleUnit
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
from teleop_rt_drivers.actuators.part import CanActuatorPart
from teleop_rt_drivers.actuators.vesc import VescCodec, VescMotor
from teleop_rt_drivers.bus import BusConfig

if TYPE_CHECKING:
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.codec import TorqueCodec

MitMotor = Literal[
    "DM4310", "DM4310_48V", "DM4340", "DM6006", "DM8006", "DM8009",
    "cybergear", "robstride00", "robstride01", "robstride02", "robstride03", "robstride04",
]  # fmt: skip

LARGEST_HOST = 0xFF
"""Of CyberGear and RobStride: bits 8 to 15 of a request's id."""


class OdrivePart(CanActuatorPart):
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

    def codec(self, rig: RigConfig) -> TorqueCodec:
        """Return CANSimple with the rig's top speed and the current's limit."""
        fastest = rig.limits.velocity_max / self.scale
        return OdriveCodec(self.node_id, self.torque_constant_Nm_per_A, fastest, self.current_max_A)


class MitCanPart(CanActuatorPart):
    """A motor with an impedance loop of its own: Damiao, CyberGear, RobStride."""

    driver: Literal["mit_can"] = Field(
        description="A motor that takes position, velocity, stiffness, damping and torque."
    )
    motor: MitMotor = Field(
        description="Type of the motor: it decides the protocol and the ranges of its values."
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
        if self.torque_max_Nm > ranges.torque:
            raise ValueError(f"{self.motor} takes torque_max_Nm up to {ranges.torque:g}")
        if self.motor in DAMIAO_RANGES:
            if self.host_id == self.motor_id:
                raise ValueError(
                    "host_id (MST_ID) must not be motor_id: answers look like commands"
                )
        elif self.host_id > LARGEST_HOST:
            raise ValueError(f"host_id must be at most {LARGEST_HOST}: it has 8 bits in an id")
        if self.motor == "cybergear" and self.watchdog_ms is not None:
            raise ValueError(
                "watchdog_ms must be null: no message sets a time-out for commands in a CyberGear"
            )
        return self


class MoteusPart(CanActuatorPart):
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
        """Return four floats, a fault code and the bytes before them, padded."""
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


class VescPart(CanActuatorPart):
    """A VESC on its own CAN mode."""

    driver: Literal["vesc"] = Field(description="A VESC, CAN mode VESC.")
    controller_id: int = Field(ge=0, le=254, description="VESC ID of its application settings.")
    turns_per_unit: float = Field(
        1.0,
        ge=1,
        le=1000,
        description="Turns of the motor in one of its position: its Position Angle Division.",
    )
    pole_pairs: int = Field(ge=1, le=100, description="Pole pairs of the motor: half its poles.")
    torque_constant_Nm_per_A: float = Field(
        gt=0, le=10, description="The motor's torque constant: 8.27 / KV."
    )
    current_max_A: float = Field(
        gt=0, le=500, description="Largest current that an operator's device is asked for."
    )
    temperature_max_C: float = Field(
        85.0,
        ge=40,
        le=150,
        description="Bridge or motor temperature above which the axis stops; the drive never does.",
    )

    @property
    def unit(self) -> AngleUnit:
        """Return turns of the position."""
        return "turn"

    @property
    def answer_bytes(self) -> tuple[int, ...]:
        """Return status messages 1 and 4."""
        return (8, 8)

    def codec(self, rig: RigConfig) -> VescCodec:  # noqa: ARG002 - it takes no limits
        """Return the protocol with the scale of the controller's values."""
        motor = VescMotor(
            self.pole_pairs,
            self.turns_per_unit,
            self.torque_constant_Nm_per_A,
            self.current_max_A,
            self.temperature_max_C,
        )
        return VescCodec(self.controller_id, motor)


CanActuator = OdrivePart | MitCanPart | MoteusPart | VescPart
"""Every drive with a protocol of its maker on a CAN bus; each can be asked for a torque."""


AskedPart = MitCanPart | MoteusPart
"""Every drive that can be asked where it is without being commanded."""


class ActuatorDeviceConfig(AxisConfig):
    """An operator's device that is one such drive: its position, and the torque it is asked for."""

    driver: Literal["actuator_device"] = Field(
        description="An operator's device that is a drive with a protocol of its maker."
    )
    drive: Annotated[CanActuator, Field(discriminator="driver")] = Field(
        description="The drive; its position is `from drive`."
    )
    answer_within_ms: float | None = Field(
        None,
        gt=0,
        le=5,
        description=(
            "Ask the drive where it is at the start of each cycle, wait this long for its answer, "
            "and command in the same cycle; null takes the position that answered the last "
            "command. Only for drives that can be asked: mit_can and moteus."
        ),
    )

    @model_validator(mode="after")
    def _can_be_asked(self) -> ActuatorDeviceConfig:
        if self.answer_within_ms is not None and self.asked is None:
            raise ValueError(
                f"answer_within_ms must be null: {self.drive.driver} sends its position by itself"
            )
        return self

    @model_validator(mode="after")
    def _measures_position(self) -> ActuatorDeviceConfig:
        if self.drive.position is None:
            raise ValueError("drive.position must be `from drive`: there is no other encoder")
        if self.drive.force is not None:
            raise ValueError("drive.force: an operator's device measures no force")
        return self

    @property
    def asked(self) -> AskedPart | None:
        """Return the drive if it is asked where it is in each cycle."""
        if self.answer_within_ms is None or not isinstance(self.drive, AskedPart):
            return None
        return self.drive

    @property
    def bus(self) -> BusConfig:
        """Return the bus of the drive."""
        return self.drive.bus

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that the drive lacks."""
        return self.drive.unsafe()
