"""The `axis` section of a CANopen rig: identities, mappings and scalings come from here and EDS."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Field, StringConstraints, model_validator

from teleop_rt.config_rig import AxisConfig
from teleop_rt.section import Damping, Force, Position, Quantity, Section, Stiffness
from teleop_rt_drivers.bus import BusConfig
from teleop_rt_drivers.quantity import DriveZero

Entry = Annotated[
    str,
    StringConstraints(pattern=r"^0x[0-9A-Fa-f]{4}(:[0-9]{1,3})?$"),
    Field(description='object dictionary entry, "0x6004" or "0x6005:1", in quotes'),
]


def _hexadecimal(value: object) -> object:
    """Read text such as 0x10 as the number that it is in every CANopen manual."""
    if isinstance(value, str) and value[:2] in ("0x", "0X"):
        return int(value, 16)
    return value


Hex = BeforeValidator(_hexadecimal)
NodeId = Annotated[int, Hex, Field(ge=1, le=127)]
CobId = Annotated[int, Hex]
Value = Annotated[int, Hex]
Word = Annotated[int, Hex, Field(ge=0, le=0xFFFFFFFF)]
PositionPerCount = Annotated[float, Quantity("{x}_per_count"), Field(gt=0)]
ForcePerCount = Annotated[float, Quantity("{f}_per_count"), Field(gt=0)]
Sign = Literal[1, -1]


class Identity(Section):
    """What object 1018h must say; the EDS must agree."""

    vendor: Word
    product: Word
    revision: Word | None = None


class PdoConfig(Section):
    """One process data object: what it carries, in order."""

    number: int = Field(ge=1, le=4)
    transmission_type: int = Field(1, ge=1, le=240, description="sent at every n-th SYNC")
    cob_id: CobId | None = Field(None, ge=0x181, le=0x57F, description="else the EDS decides")
    objects: tuple[Entry, ...] = Field(min_length=1, max_length=8)


class GuardingConfig(Section):
    """Node guarding, for a device without heartbeat (1017h): it is asked, and answers."""

    period_ms: int = Field(20, ge=1, le=10_000, description="guard time (100Ch)")
    life_factor: int = Field(3, ge=2, le=255, description="periods of silence allowed (100Dh)")


class NodeConfig(Section):
    """A device: where it is, what it is, and what to write and expect in it."""

    node_id: NodeId
    eds: str = Field(min_length=1, description="a file of this package's eds folder, or a path")
    identity: Identity
    heartbeat_ms: int = Field(20, ge=1, le=10_000)
    heartbeat_timeout_ms: int = Field(60, ge=2, le=60_000)
    guarding: GuardingConfig | None = Field(None, description="instead of the heartbeat")
    setup: dict[Entry, Value] = Field({}, description="written and read back at start-up")
    expect: dict[Entry, Value] = Field({}, description="read at start-up; another value is refused")

    @property
    def silence_ms(self) -> int:
        """Return the silence after which the device is lost."""
        guarding = self.guarding
        if guarding is None:
            return self.heartbeat_timeout_ms
        return guarding.period_ms * guarding.life_factor

    @model_validator(mode="after")
    def _timeout_above_period(self) -> NodeConfig:
        if self.heartbeat_timeout_ms <= self.heartbeat_ms:
            raise ValueError("heartbeat_timeout_ms must be above heartbeat_ms")
        return self


class Resolution(Section):
    """The entry in which a device tells its measuring step, and the entry's unit."""

    entry: Entry
    unit: Position = Field(gt=0)


class EncoderConfig(NodeConfig):
    """The position encoder."""

    tpdo: PdoConfig
    position: Entry
    speed: Entry | None = None
    alarms: Entry | None = None
    scale: PositionPerCount
    sign: Sign = 1
    offset: Position = 0.0
    resolution: Resolution | None = None


class ForceConfig(NodeConfig):
    """The force sensor."""

    tpdo: PdoConfig
    force: Entry
    status: Entry | None = None
    scale: ForcePerCount
    sign: Sign = 1
    offset: Force = 0.0


class SwitchConfig(Section):
    """A home switch at the drive's digital inputs, in a process data object of its own."""

    tpdo: PdoConfig
    entry: Entry = "0x60FD"
    bit: int = Field(2, ge=0, le=31, description="CiA 402: 0, 1 limit switches, 2 home switch")
    closed: Literal[0, 1] = 1


class TorqueConfig(Section):
    """The position loop that this program closes where the drive takes forces."""

    rated_force: Force = Field(gt=0, description="force at the motor's rated torque (6076h)")
    rated_count: Force = Field(1e-3, gt=0, description="force of one count of 6076h")
    stiffness: Stiffness = Field(gt=0)
    damping: Damping = Field(gt=0)


class DriveConfig(NodeConfig):
    """The drive, in a cyclic synchronous mode: position (8), or torque (10)."""

    tpdo: PdoConfig
    rpdo: PdoConfig
    scale: PositionPerCount
    sign: Sign = 1
    offset: Position = 0.0
    zero: DriveZero = "encoder"
    torque: TorqueConfig | None = Field(None, description="drive it by force: mode 10")
    switch: SwitchConfig | None = None
    daemon_timeout_ms: int = Field(
        60, ge=2, le=60_000, description="the drive stops by itself after this silence (1016h)"
    )


class DaemonConfig(Section):
    """The daemon as a node of the network."""

    node_id: NodeId = 127
    heartbeat_ms: int = Field(20, ge=1, le=10_000)
    sync_cob_id: CobId = Field(0x80, ge=0x80, le=0xFF)
    sync_counter: int | None = Field(
        None, ge=2, le=240, description="SYNC carries a count from 1 up to this (1019h)"
    )
    answer_timeout_ms: int = Field(300, ge=1, le=10_000)
    attempts: int = Field(5, ge=1, le=100, description="tries to reach a device at start-up")
    listen_ms: int = Field(50, ge=0, le=10_000, description="listens this long for other masters")

    @property
    def sync_bytes(self) -> int:
        """Return the length of a SYNC frame."""
        return 0 if self.sync_counter is None else 1


class CanopenPart(AxisConfig):
    """Devices on a CANopen bus: all of an axis, or its part of a mixed one."""

    driver: Literal["canopen", "canopen_device"]
    bus: BusConfig
    daemon: DaemonConfig = DaemonConfig()
    encoder: EncoderConfig | None = None
    force: ForceConfig | None = None
    drive: DriveConfig | None = None

    @property
    def nodes(self) -> dict[str, NodeConfig]:
        """Return the devices by the name that messages call them."""
        named = {"encoder": self.encoder, "force sensor": self.force, "drive": self.drive}
        return {name: node for name, node in named.items() if node is not None}

    @model_validator(mode="after")
    def _consistent(self) -> CanopenPart:
        if not self.nodes:
            raise ValueError("name at least one of encoder, force and drive")
        ids = [self.daemon.node_id, *(node.node_id for node in self.nodes.values())]
        if len(set(ids)) != len(ids):
            raise ValueError(f"node ids must differ: {ids}")
        if self.drive and self.drive.daemon_timeout_ms <= self.daemon.heartbeat_ms:
            raise ValueError("drive.daemon_timeout_ms must be above daemon.heartbeat_ms")
        return self


class CanopenConfig(CanopenPart):
    """A whole axis on one CANopen bus."""

    driver: Literal["canopen"]
    encoder: EncoderConfig
    force: ForceConfig
    drive: DriveConfig


class CanopenDeviceConfig(CanopenPart):
    """An operator's device: its position, and a drive that is commanded by force."""

    driver: Literal["canopen_device"]
    encoder: EncoderConfig
    drive: DriveConfig

    @model_validator(mode="after")
    def _by_force(self) -> CanopenDeviceConfig:
        if self.drive.torque is None:
            raise ValueError("drive.torque is missing: an operator's device is driven by force")
        return self


def address(entry: str) -> tuple[int, int]:
    """Return (index, sub-index) of an entry such as "0x6005:1"."""
    index, _, subindex = entry.partition(":")
    return int(index, 16), int(subindex or 0)
