"""The drive of a CANopen rig, and the safeguards that it may lack."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from teleop_rt.config.section import Damping, Force, Position, Quantity, Section, Stiffness
from teleop_rt.config.supervision import LONGEST_WATCH_MS, UnsafeWord
from teleop_rt_drivers.canopen.cia402 import ACTUAL_TORQUE
from teleop_rt_drivers.canopen.entries import (
    Entry,
    PositionPerCount,
    Sign,
    address,
)
from teleop_rt_drivers.canopen.node_config import ForceReading, NodeConfig, PdoConfig
from teleop_rt_drivers.quantity import DriveZero

CONNECTION_LOSS = (0x6007, 0)
"""Reaction of the drive to a lost daemon (CiA 402): 1 fault, 2 no voltage, 3 quick stop."""


class SwitchConfig(Section):
    """A home switch at the drive's digital inputs, in a process data object of its own."""

    tpdo: PdoConfig = Field(
        description="Process data object in which the drive sends its digital inputs."
    )
    entry: Entry = Field("0x60FD", description="Entry with the digital inputs, 0x60FD on CiA 402.")
    bit: int = Field(
        2,
        ge=0,
        le=31,
        description=(
            "Bit of the home switch; CiA 402 has limit switches at 0 and 1 and the home switch at "
            "2."
        ),
    )
    closed: Literal[0, 1] = Field(1, description="Value of that bit while the switch is closed.")


class ForceInputConfig(ForceReading):
    """A force sensor's amplifier at an analog input of the drive, for `force: from drive input`."""

    lowest: int = Field(
        ge=-(2**31),
        le=2**31,
        description=(
            "Smallest count that the input still measures; a reading below it is saturated and is "
            "rejected."
        ),
    )
    highest: int = Field(
        ge=-(2**31),
        le=2**31,
        description=(
            "Largest count that the input still measures; a reading above it is saturated and is "
            "rejected."
        ),
    )

    @model_validator(mode="after")
    def _has_range(self) -> ForceInputConfig:
        if self.lowest >= self.highest:
            raise ValueError("lowest must be below highest")
        return self


class TorqueConfig(Section):
    """The position loop that this program closes where the drive takes forces."""

    rated_force: Force = Field(
        gt=0,
        description=(
            "Force (or torque) at the motor's rated torque; it must agree with the drive's own "
            "6076h."
        ),
    )
    rated_count: Force = Field(
        1e-3, gt=0, description="Force (or torque) of one count of 6076h; 0.001 by CiA 402."
    )
    stiffness: Stiffness = Field(
        gt=0, description="Stiffness of the position loop that this program closes over the drive."
    )
    damping: Damping = Field(
        gt=0, description="Damping of the position loop that this program closes over the drive."
    )


class DriveConfig(NodeConfig):
    """The drive, in a cyclic synchronous mode: position (8), or torque (10)."""

    tpdo: PdoConfig = Field(
        description=(
            "Process data object in which the drive sends status word, actual torque and actual "
            "position."
        )
    )
    rpdo: PdoConfig = Field(
        description=(
            "Process data object in which the drive takes control word, target torque and target "
            "position."
        )
    )
    scale: PositionPerCount = Field(description="Rig units of position per count of the drive.")
    speed_count: Annotated[float | None, Quantity("{x}_per_s"), Field(gt=0)] = Field(
        None,
        description=(
            "Speed of one count of the drive's largest speed (607Fh), where its unit of speeds "
            "(60A9h) is its own, such as rpm; null: one count of position per second."
        ),
    )
    sign: Sign = Field(
        1,
        description=(
            "Direction in which the drive counts: 1 where its counts rise towards the environment,"
            " else -1."
        ),
    )
    offset: Position = Field(0.0, description="Position at the drive's count 0.")
    zero: DriveZero = Field(
        "encoder",
        description=(
            "Where the drive counts from: as the encoder does (encoder), or from anywhere "
            "(unknown), then it is aligned with the encoder when power comes on."
        ),
    )
    torque: TorqueConfig | None = Field(
        None,
        description=(
            "Position loop for a drive that takes forces (cyclic synchronous torque, mode 10); "
            "null commands positions (mode 8)."
        ),
    )
    rated_force: Annotated[float | None, Quantity("{f}"), Field(gt=0)] = Field(
        None,
        description=(
            "Force (or torque) at the motor's rated torque, which 0x6077 counts in thousandths of;"
            " compared with the force sensor. Null where torque gives it, or nothing does."
        ),
    )
    switch: SwitchConfig | None = Field(
        None, description="Home switch at the drive's digital inputs; null where there is none."
    )
    force_input: ForceInputConfig | None = Field(
        None,
        description=(
            "Analog input that the force sensor is wired to, with `force: from drive input`; null "
            "where there is none."
        ),
    )
    daemon_timeout_ms: int = Field(
        60,
        ge=2,
        le=60_000,
        description=(
            "Silence of this program's heartbeat after which the drive stops by itself (1016h); "
            "above daemon.heartbeat_ms, 60 is usual."
        ),
    )

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that this drive lacks."""
        lacks: dict[UnsafeWord, str] = {}
        written = {address(entry): value for entry, value in self.setup.items()}
        if written.get(CONNECTION_LOSS) not in (1, 2, 3):
            lacks["connection_loss"] = (
                "drive.setup does not set 0x6007 to 1, 2 or 3, so that the drive stops when the"
                " daemon is lost"
            )
        if self.daemon_timeout_ms > LONGEST_WATCH_MS:
            lacks["watchdog"] = (
                f"drive.daemon_timeout_ms {self.daemon_timeout_ms} is above {LONGEST_WATCH_MS}:"
                " so long the drive goes on without the daemon"
            )
        if not self.measures_force:
            lacks["force_comparison"] = (
                "the drive's force is not measured (0x6077 in drive.tpdo, and drive.rated_force):"
                " nothing is compared with the force sensor"
            )
        return lacks

    @property
    def tpdos(self) -> dict[str, PdoConfig]:
        """Return the process data objects that the drive sends, by their key in the config."""
        sent = {"tpdo": self.tpdo}
        if self.switch is not None:
            sent["switch.tpdo"] = self.switch.tpdo
        if self.force_input is not None:
            sent["force_input.tpdo"] = self.force_input.tpdo
        return sent

    @model_validator(mode="after")
    def _sends_each_once(self) -> DriveConfig:
        numbers = {key: pdo.number for key, pdo in self.tpdos.items()}
        if len(set(numbers.values())) != len(numbers):
            raise ValueError(f"the numbers of {' and '.join(numbers)} must differ: {numbers}")
        return self

    @property
    def rated(self) -> float | None:
        """Return the force at rated torque, None where it is not known."""
        return self.rated_force if self.torque is None else self.torque.rated_force

    @property
    def measures_force(self) -> bool:
        """Return whether the drive's force can be known."""
        return ACTUAL_TORQUE in self.tpdo.objects and self.rated is not None
