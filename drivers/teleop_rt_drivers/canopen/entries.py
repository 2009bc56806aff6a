"""Entries of object dictionaries and numbers of CANopen, as a rig's file writes them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, GetCoreSchemaHandler, GetJsonSchemaHandler, StringConstraints
from pydantic.json_schema import JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from teleop_rt.config.section import Quantity

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


NodeId = Annotated[int, Field(ge=1, le=127), Hex]
PdoId = Annotated[int, Field(ge=0x181, le=0x57F), Hex]
SyncId = Annotated[int, Field(ge=0x80, le=0xFF), Hex]
Value = Annotated[int, Field(ge=-(2**63), lt=2**64), Hex]
Word = Annotated[int, Field(ge=0, le=0xFFFFFFFF), Hex]
PositionPerCount = Annotated[float, Quantity("{x}_per_count"), Field(gt=0)]
ForcePerCount = Annotated[float, Quantity("{f}_per_count"), Field(gt=0)]
Sign = Literal[1, -1]


def address(entry: str) -> tuple[int, int]:
    """Return (index, sub-index) of an entry such as "0x6005:1"."""
    index, _, subindex = entry.partition(":")
    return int(index, 16), int(subindex or 0)
