"""The sensors of a CANopen rig, and the keys of every device: identity, watch, process data."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, model_validator
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from teleop_rt.config.section import Force, Position, Section
from teleop_rt_drivers.canopen.entries import (
    Entry,
    ForcePerCount,
    NodeId,
    PdoId,
    PositionPerCount,
    Sign,
    Value,
    Word,
    address,
)
from teleop_rt_drivers.quantity import FROM_DRIVE, FROM_INPUT, FromDrive, FromInput

OURS = (0x1016, 0x6040, 0x6060, 0x6071, 0x607A)
"""Watch over this program, control word, mode and targets: they decide whether the drive moves."""


class Identity(Section):
    """Required content of object 1018h; the EDS must agree."""

    vendor: Word = Field(
        description="Vendor id that the device must report (1018h:1), such as 0x543."
    )
    product: Word = Field(description="Product code that the device must report (1018h:2).")
    revision: Word | None = Field(
        None, description="Revision number that the device must report (1018h:3); null accepts any."
    )


class PdoConfig(Section):
    """One process data object: its entries, in order."""

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
    """A device: its place, its identity, and the entries to write and to expect in it."""

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
        description="Period of the heartbeat that the device is configured to send (1017h).",
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
    def _leaves_our_own(self) -> NodeConfig:
        for entry in self.setup:
            if address(entry)[0] in OURS:
                raise ValueError(f"setup: {entry} is written by this program alone: remove it")
        return self

    @model_validator(mode="after")
    def _timeout_above_period(self) -> NodeConfig:
        if self.heartbeat_timeout_ms <= self.heartbeat_ms:
            raise ValueError("heartbeat_timeout_ms must be above heartbeat_ms")
        return self


class Resolution(Section):
    """The entry with a device's measuring step, and the entry's unit."""

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


class ForceReading(Section):
    """A force among process data: its place, and the meaning of a count."""

    tpdo: PdoConfig = Field(
        description="Process data object in which the device sends the reading of the force."
    )
    force: Entry = Field(
        description=(
            "Entry with the force in counts, part of the tpdo: 0x9130:1 on CiA 404, 0x6401:1 for "
            "an analog input of CiA 401."
        )
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


class ForceConfig(ForceReading, NodeConfig):
    """The force sensor, a device of its own."""


_OF_DRIVE = (FROM_DRIVE, FROM_INPUT)
"""Words in place of a section: the motor's torque, or an analog input of the drive."""


class _SensorOrDrive:
    """Annotation of a force sensor's section, in place of which words for the drive may stand.

    A union would report the problems of both.
    """

    @classmethod
    def __get_pydantic_core_schema__(
        cls, source: object, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        section = handler.generate_schema(ForceConfig)
        return core_schema.no_info_wrap_validator_function(
            lambda value, validate: value if value in _OF_DRIVE else validate(value),
            section,
            serialization=core_schema.wrap_serializer_function_ser_schema(
                lambda value, dump: value if value in _OF_DRIVE else dump(value), schema=section
            ),
        )

    @classmethod
    def __get_pydantic_json_schema__(
        cls, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> JsonSchemaValue:
        return {"anyOf": [handler(schema), {"enum": list(_OF_DRIVE), "type": "string"}]}


ForceSource = Annotated[ForceConfig | FromDrive | FromInput, _SensorOrDrive]
