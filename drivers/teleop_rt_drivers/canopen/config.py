"""The `axis` section of a CANopen rig: identities, mappings and scalings come from here and EDS."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    StringConstraints,
    model_validator,
)
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from teleop_rt.config_rig import AxisConfig
from teleop_rt.config_supervision import LONGEST_WATCH_MS, UnsafeWord
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


class Hex:
    """Annotation of a whole number that may be written as text such as "0x10"."""

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(_hexadecimal, handler(source))

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        text = {"type": "string", "pattern": "^0[xX][0-9A-Fa-f]+$"}
        return {"anyOf": [handler(schema), text]}


ACTUAL_TORQUE = "0x6077"
NodeId = Annotated[int, Field(ge=1, le=127), Hex]
PdoId = Annotated[int, Field(ge=0x181, le=0x57F), Hex]
SyncId = Annotated[int, Field(ge=0x80, le=0xFF), Hex]
Value = Annotated[int, Hex]
Word = Annotated[int, Field(ge=0, le=0xFFFFFFFF), Hex]
PositionPerCount = Annotated[float, Quantity("{x}_per_count"), Field(gt=0)]
ForcePerCount = Annotated[float, Quantity("{f}_per_count"), Field(gt=0)]
Sign = Literal[1, -1]


class Identity(Section):
    """What object 1018h must say; the EDS must agree."""

    vendor: Word = Field(
        description="Vendor id that the device must report (1018h:1), such as 0x543."
    )
    product: Word = Field(description="Product code that the device must report (1018h:2).")
    revision: Word | None = Field(
        None, description="Revision number that the device must report (1018h:3); null accepts any."
    )


class PdoConfig(Section):
    """One process data object: what it carries, in order."""

    number: int = Field(
        ge=1, le=4, description="Number of the process data object in the device, 1 to 4."
    )
    transmission_type: int = Field(
        1,
        ge=1,
        le=255,
        description=(
            "The object is sent, or taken over, at every n-th SYNC, 1 to 240; a command of type "
            "254 or 255 acts when it is received."
        ),
    )
    cob_id: PdoId | None = Field(
        None, description="CAN id of the object; null takes that of the EDS."
    )
    objects: tuple[Entry, ...] = Field(
        min_length=1,
        max_length=8,
        description="Entries that the object carries, in order; eight bytes at most.",
    )

    @model_validator(mode="after")
    def _known_type(self) -> PdoConfig:
        if 240 < self.transmission_type < 254:
            raise ValueError("transmission_type must be 1 to 240, 254 or 255")
        return self


class GuardingConfig(Section):
    """Node guarding, for a device without heartbeat (1017h): it is asked, and answers."""

    period_ms: int = Field(
        20,
        ge=1,
        le=10_000,
        description="Guard time (100Ch): how often the device is asked for a sign of life.",
    )
    life_factor: int = Field(
        3,
        ge=2,
        le=255,
        description="Guard times of silence after which the device counts as lost (100Dh).",
    )


class NodeConfig(Section):
    """A device: where it is, what it is, and what to write and expect in it."""

    node_id: NodeId = Field(
        description=(
            "CANopen node id of the device, 1 to 127; it differs from those of the others and of "
            "the daemon."
        )
    )
    eds: str = Field(
        min_length=1,
        description=(
            "Electronic data sheet of the device: a file of this package's eds folder, or a path."
        ),
    )
    identity: Identity = Field(
        description=(
            "What the device must say that it is; another device is refused before anything moves."
        )
    )
    heartbeat_ms: int = Field(
        20,
        ge=1,
        le=10_000,
        description="Period of the heartbeat that the device is told to send (1017h).",
    )
    heartbeat_timeout_ms: int = Field(
        60,
        ge=2,
        le=60_000,
        description=(
            "Silence of the heartbeat after which the device counts as lost; above heartbeat_ms, "
            "three times it is usual."
        ),
    )
    guarding: GuardingConfig | None = Field(
        None,
        description=(
            "Node guarding in place of the heartbeat, for a device that has none; null uses the "
            "heartbeat."
        ),
    )
    setup: dict[Entry, Value] = Field(
        {}, description="Values to write at start-up, by entry; each is read back and compared."
    )
    expect: dict[Entry, Value] = Field(
        {},
        description=(
            "Values to read at start-up, by entry; a device with another value is refused."
        ),
    )

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

    entry: Entry = Field(description="Entry in which the device states its measuring step.")
    unit: Position = Field(
        gt=0,
        description=(
            "Unit of that entry, in the rig's unit of position: 1e-9 for an entry in 0.001 um."
        ),
    )


class EncoderConfig(NodeConfig):
    """The position encoder."""

    tpdo: PdoConfig = Field(
        description="Process data object in which the encoder sends its position."
    )
    position: Entry = Field(
        description="Entry with the position in counts, 0x6004 on CiA 406; part of the tpdo."
    )
    speed: Entry | None = Field(
        None,
        description=(
            "Entry with the encoder's own speed; samples at the end of its range are counted as "
            "saturated."
        ),
    )
    alarms: Entry | None = Field(
        None,
        description=(
            "Entry with the encoder's alarms (0x6503 on CiA 406); a position that comes with an "
            "alarm is rejected."
        ),
    )
    scale: PositionPerCount = Field(description="Rig units of position per count.")
    sign: Sign = Field(
        1,
        description=(
            "Direction in which the encoder counts: 1 where its counts rise towards the "
            "environment, else -1."
        ),
    )
    offset: Position = Field(0.0, description="Position at count 0.")
    resolution: Resolution | None = Field(
        None,
        description=(
            "Where the encoder states its measuring step, which must agree with scale; null checks"
            " nothing."
        ),
    )


class ForceConfig(NodeConfig):
    """The force sensor."""

    tpdo: PdoConfig = Field(
        description="Process data object in which the force sensor sends its reading."
    )
    force: Entry = Field(
        description="Entry with the force in counts, 0x9130:1 on CiA 404; part of the tpdo."
    )
    status: Entry | None = Field(
        None,
        description=(
            "Entry with the channel's status (0x6150:1 on CiA 404); a force that comes with "
            "another status than 0 is rejected."
        ),
    )
    scale: ForcePerCount = Field(description="Rig units of force per count.")
    sign: Sign = Field(
        1,
        description=(
            "Direction of the sensor: 1 where its counts rise when the tool presses, else -1."
        ),
    )
    offset: Force = Field(0.0, description="Force at count 0.")


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
        option = self.setup.get("0x6007", 0)
        if option not in (1, 2, 3):
            lacks["connection_loss"] = (
                "drive.setup does not set 0x6007 to 1, 2 or 3, so that the drive stops when the"
                " daemon is lost"
            )
        if self.daemon_timeout_ms > LONGEST_WATCH_MS:
            lacks["watchdog"] = (
                f"drive.daemon_timeout_ms {self.daemon_timeout_ms} is above {LONGEST_WATCH_MS}:"
                " so long the drive goes on without the daemon"
            )
        if ACTUAL_TORQUE not in self.tpdo.objects or self._rated is None:
            lacks["force_comparison"] = (
                "the drive's force is not measured (0x6077 in drive.tpdo, and drive.rated_force):"
                " nothing is compared with the force sensor"
            )
        return lacks

    @property
    def _rated(self) -> float | None:
        return self.rated_force if self.torque is None else self.torque.rated_force


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
    force: ForceConfig | None = Field(
        None, description="The force sensor; null where another part gives the force."
    )
    drive: DriveConfig | None = Field(
        None, description="The servo drive; null where another part drives."
    )

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
        for name, node in self.nodes.items():
            tpdo: PdoConfig = node.tpdo  # type: ignore[attr-defined]  # every device sends one
            if tpdo.transmission_type > 240:
                raise ValueError(f"{name}: a sample must answer a SYNC: tpdo.transmission_type 1")
        if self.drive and self.drive.daemon_timeout_ms <= self.daemon.heartbeat_ms:
            raise ValueError("drive.daemon_timeout_ms must be above daemon.heartbeat_ms")
        return self

    def unsafe(self) -> dict[UnsafeWord, str]:
        """Return the safeguards that the drive lacks, and devices that are missed late."""
        lacks = {} if self.drive is None else self.drive.unsafe()
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
    encoder: EncoderConfig = Field(description="The position encoder.")
    force: ForceConfig = Field(description="The force sensor.")
    drive: DriveConfig = Field(description="The servo drive.")


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


def address(entry: str) -> tuple[int, int]:
    """Return (index, sub-index) of an entry such as "0x6005:1"."""
    index, _, subindex = entry.partition(":")
    return int(index, 16), int(subindex or 0)
