"""The `axis` section of a CANopen rig: its devices on one bus, with the daemon as a node."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from teleop_rt.config.rig import AxisConfig
from teleop_rt.config.section import Section
from teleop_rt.config.supervision import LONGEST_WATCH_MS, UnsafeWord
from teleop_rt_drivers.bus import BusConfig
from teleop_rt_drivers.canopen.drive_config import DriveConfig
from teleop_rt_drivers.canopen.entries import NodeId, SyncId
from teleop_rt_drivers.canopen.node_config import (
    EncoderConfig,
    ForceConfig,
    ForceReading,
    ForceSource,
    NodeConfig,
    PdoConfig,
)
from teleop_rt_drivers.drivetrain import FORCE_NOT_COMPARED, DrivetrainConfig
from teleop_rt_drivers.quantity import FROM_DRIVE, FROM_INPUT, FromDrive


class DaemonConfig(Section):
    """The daemon as a node of the network."""

    node_id: NodeId = Field(127, description="Node id of this program, 127 by custom.")
    heartbeat_ms: int = Field(
        20,
        ge=1,
        le=10_000,
        description="Period of this program's own heartbeat, by which the drive watches it.",
    )
    sync_cob_id: SyncId = Field(0x80, description="CAN id of SYNC, 0x80 by CiA 301.")
    sync_counter: int | None = Field(
        None,
        ge=2,
        le=240,
        description="SYNC carries a count from 1 up to this (1019h); null sends it empty.",
    )
    answer_timeout_ms: int = Field(
        300,
        ge=1,
        le=10_000,
        description=(
            "Time that a device has to answer a read or write of its dictionary at start-up."
        ),
    )
    attempts: int = Field(5, ge=1, le=100, description="Tries to reach each device at start-up.")
    listen_ms: int = Field(
        50,
        ge=0,
        le=10_000,
        description=(
            "Time to listen for another master before anything is sent; one that is heard is "
            "refused."
        ),
    )

    @property
    def sync_bytes(self) -> int:
        """Return the length of a SYNC frame."""
        return 0 if self.sync_counter is None else 1


class CanopenPart(AxisConfig):
    """Devices on a CANopen bus: all of an axis, or its part of a mixed one."""

    driver: Literal["canopen", "canopen_device"] = Field(
        description=(
            "Devices on a CANopen bus: a whole axis (canopen) or an operator's device "
            "(canopen_device)."
        )
    )
    bus: BusConfig = Field(description="The CAN bus that the devices are on.")
    daemon: DaemonConfig = Field(
        DaemonConfig(), description="This program as a node of the network."
    )
    encoder: EncoderConfig | None = Field(
        None, description="The position encoder; null where another part gives the position."
    )
    position: FromDrive | None = Field(
        None,
        description=(
            "`from drive`: the drive's own encoder (6064h) is the rig's, and there is no other; "
            "null: `encoder` or another part has it."
        ),
    )
    force: ForceSource | None = Field(
        None,
        description=(
            "The force sensor; or `from drive`: the motor's torque (6077h) is taken for the force, "
            "with all friction in between; or `from drive input`: the sensor is at an analog input "
            "of the drive (drive.force_input); null where another part gives the force."
        ),
    )
    drivetrain: DrivetrainConfig | None = Field(
        None,
        description=(
            "Friction and mass that `force: from drive` is freed of; null corrects nothing."
        ),
    )
    drive: DriveConfig | None = Field(
        None, description="The servo drive; null where another part drives."
    )

    @property
    def force_sensor(self) -> ForceConfig | None:
        """Return the force sensor, None where there is none."""
        return self.force if isinstance(self.force, ForceConfig) else None

    @property
    def force_reading(self) -> ForceReading | None:
        """Return where a force sensor is read, of its own or at the drive, None without one."""
        if self.force == FROM_INPUT and self.drive is not None:
            return self.drive.force_input
        return self.force_sensor

    @property
    def force_from_drive(self) -> bool:
        """Whether the force is the motor's torque."""
        return self.force == FROM_DRIVE

    def arrival_deviation_s(self, period_s: float) -> float:  # noqa: ARG002 - as of other parts
        """Return the standard deviation of a value's stamp [s]: one SYNC latches all."""
        return 0.0

    @property
    def nodes(self) -> dict[str, NodeConfig]:
        """Return the devices by the name that messages call them."""
        named = {"encoder": self.encoder, "force sensor": self.force_sensor, "drive": self.drive}
        return {name: node for name, node in named.items() if node is not None}

    @property
    def tpdos(self) -> list[tuple[str, PdoConfig]]:
        """Return every process data object that a device sends, with the device's name."""
        sent = [
            (name, node.tpdo)
            for name, node in (("encoder", self.encoder), ("force sensor", self.force_sensor))
            if node is not None
        ]
        own = () if self.drive is None else self.drive.tpdos.values()
        return sent + [("drive", tpdo) for tpdo in own]

    @model_validator(mode="after")
    def _consistent(self) -> CanopenPart:
        if not self.nodes:
            raise ValueError("name at least one of encoder, force and drive")
        ids = [self.daemon.node_id, *(node.node_id for node in self.nodes.values())]
        if len(set(ids)) != len(ids):
            raise ValueError(f"node ids must differ: {ids}")
        self._refuse_unasked()
        if self.position is not None:
            self._refuse_two_positions()
        if self.force == FROM_DRIVE and not (self.drive and self.drive.measures_force):
            raise ValueError("force: from drive needs 0x6077 in drive.tpdo, and drive.rated_force")
        wired = self.drive is not None and self.drive.force_input is not None
        if self.force == FROM_INPUT and not wired:
            raise ValueError("force: from drive input needs drive.force_input")
        if self.force != FROM_INPUT and wired:
            raise ValueError("drive.force_input is only for force: from drive input")
        if self.drivetrain is not None and self.force != FROM_DRIVE:
            raise ValueError("drivetrain is only for force: from drive")
        if self.drivetrain is not None and self.encoder is None and self.position is None:
            raise ValueError("drivetrain needs the position on the drive's own bus")
        if self.drive and self.drive.daemon_timeout_ms <= self.daemon.heartbeat_ms:
            raise ValueError("drive.daemon_timeout_ms must be above daemon.heartbeat_ms")
        return self

    def _refuse_unasked(self) -> None:
        """Refuse a sample that does not answer a SYNC."""
        switch = None if self.drive is None or self.drive.switch is None else self.drive.switch.tpdo
        for name, tpdo in self.tpdos:
            if tpdo.transmission_type > 240 and tpdo is not switch:
                raise ValueError(
                    f"{name}: a sample must answer a SYNC: transmission_type of TPDO"
                    f" {tpdo.number} is 1"
                )

    def _refuse_two_positions(self) -> None:
        if self.drive is None or self.encoder is not None:
            raise ValueError("position: from drive needs a drive, and no encoder beside it")
        if self.drive.zero != "encoder":
            raise ValueError("drive.zero: unknown cannot be combined with position: from drive")

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that the drive lacks, and devices that are missed late."""
        lacks = {} if self.drive is None else self.drive.unsafe()
        if self.position is not None:
            lacks["position_comparison"] = (
                "position is the drive's own: no second encoder is compared with it"
            )
        if self.force == FROM_DRIVE:
            lacks["force_comparison"] = FORCE_NOT_COMPARED
        late = [name for name, node in self.nodes.items() if node.silence_ms > LONGEST_WATCH_MS]
        if late:
            lacks["device_timeout"] = (
                f"a silent {' and '.join(late)} is noticed after more than {LONGEST_WATCH_MS} ms"
                " (heartbeat_timeout_ms, guarding)"
            )
        return lacks


class CanopenConfig(CanopenPart):
    """A whole axis on one CANopen bus."""

    driver: Literal["canopen"] = Field(description="A whole axis on one CANopen bus.")
    encoder: EncoderConfig | None = Field(
        None, description="The position encoder; null with `position: from drive`."
    )
    force: ForceSource = Field(
        description=(
            "The force sensor; or `from drive`, the motor's torque (6077h); or `from drive input`, "
            "a sensor at an analog input of the drive (drive.force_input)."
        )
    )
    drive: DriveConfig = Field(description="The servo drive.")

    @model_validator(mode="after")
    def _has_position(self) -> CanopenConfig:
        if self.encoder is None and self.position is None:
            raise ValueError("encoder is missing: describe it, or write `position: from drive`")
        return self


class CanopenDeviceConfig(CanopenPart):
    """An operator's device: its position, and a drive that is commanded by force."""

    driver: Literal["canopen_device"] = Field(
        description="An operator's device on one CANopen bus."
    )
    encoder: EncoderConfig = Field(description="The position encoder.")
    drive: DriveConfig = Field(
        description="The drive, commanded by force: its torque section is required."
    )
    answer_within_ms: float | None = Field(
        None,
        gt=0,
        le=5,
        description=(
            "Wait this long for the answers to SYNC, and command in the same cycle; null "
            "reads them a cycle later."
        ),
    )

    @model_validator(mode="after")
    def _by_force(self) -> CanopenDeviceConfig:
        if self.drive.torque is None:
            raise ValueError("drive.torque is missing: an operator's device is driven by force")
        return self
