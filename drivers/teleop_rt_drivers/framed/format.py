"""The YAML description of a serial frame: the table of a data sheet, and nothing else."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import (
    AfterValidator,
    Field,
    ValidationError,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from teleop_rt.axis import AxisError
from teleop_rt.config.problems import problem_of
from teleop_rt.config.section import AnySize, Section
from teleop_rt.config.yaml_file import ConfigError, read_yaml
from teleop_rt_drivers.framed.checksum import ChecksumKind, checksum

STRUCT = {
    "u8": "B",
    "i8": "b",
    "u16": "H",
    "i16": "h",
    "u24": "3s",
    "i24": "3s",
    "u32": "I",
    "i32": "i",
    "u64": "Q",
    "i64": "q",
    "f32": "f",
    "f64": "d",
}
Place = Annotated[int, Field(ge=0, le=4096)]
"""Of a byte in a frame; sync, 64 fields and checksum have fewer."""
THREE_BYTES = ("u24", "i24")
"""Numbers of converters with 24 bits, which struct does not know."""
SIZE = {name: int(name[1:]) // 8 for name in STRUCT}


def _is_hex(text: str) -> str:
    """Refuse all but a row of bytes."""
    try:
        bytes.fromhex(text)
    except ValueError:
        raise ValueError('write bytes as hexadecimal text, such as "55 AA"') from None
    return text


def _named_once(fields: tuple[AnyField, ...]) -> tuple[AnyField, ...]:
    """Return fields, of which no two may have one name. Raises ValueError."""
    names = [field.name for field in fields]
    twice = next((name for place, name in enumerate(names) if name in names[:place]), None)
    if twice is not None:
        raise ValueError(f"two fields are named {twice!r}: give each a name of its own")
    return fields


HexBytes = Annotated[
    str,
    AfterValidator(_is_hex),
    WithJsonSchema({"type": "string", "pattern": r"^\s*([0-9A-Fa-f]{2}\s*)*$"}),
]


AnyField = TypeVar("AnyField", "BinaryField", "TextField")


class BinaryField(Section):
    """One field of a binary frame: value = raw * scale / divisor + offset, in `unit`."""

    name: str = Field(
        min_length=1, description="Name of the field, by which the rig's file refers to it."
    )
    type: Literal[
        "u8", "i8", "u16", "i16", "u24", "i24", "u32", "i32", "u64", "i64", "f32", "f64"
    ] = Field(
        description=(
            "Number format of the field: u unsigned, i signed, f floating point, and its bits."
        )
    )
    scale: AnySize = Field(1.0, description="Factor: value = raw * scale / divisor + offset.")
    divisor: AnySize = Field(
        1.0,
        description=(
            "Divisor: value = raw * scale / divisor + offset; data sheets often give 100 or 1000."
        ),
    )
    offset: AnySize = Field(0.0, description="Offset: value = raw * scale / divisor + offset.")
    unit: str = Field(
        "1",
        description=(
            "Unit of the value, such as N, m, count or 1; a unit other than the rig's needs a "
            "scale in the rig's file."
        ),
    )

    @model_validator(mode="after")
    def _scaled(self) -> BinaryField:
        if self.scale == 0 or self.divisor == 0:
            raise ValueError("scale and divisor must not be 0")
        return self


class ChecksumField(Section):
    """The checksum, which follows the fields."""

    kind: ChecksumKind = Field(description="Kind of checksum, by the name that data sheets use.")
    span: tuple[Place, Place] | None = Field(
        None,
        description=(
            "First byte, and the byte after the last, that the checksum covers; null covers all "
            "from the sync bytes' end to the checksum."
        ),
    )


class BinaryFormat(Section):
    """Frames of one length that begin with known bytes."""

    kind: Literal["binary"] = Field(description="Frames of one length that begin with known bytes.")
    sync: HexBytes = Field(
        min_length=2,
        description='Bytes that every frame begins with, as hexadecimal text such as "A5 5A".',
    )
    end: HexBytes = Field(
        "", description="Bytes that every frame ends with, as hexadecimal text; empty for none."
    )
    byte_order: Literal["little", "big"] = Field(
        "little",
        description="Order of the bytes of a number: little (least significant first) or big.",
    )
    fields: tuple[BinaryField, ...] = Field(
        min_length=1, max_length=64, description="Fields between sync bytes and checksum, in order."
    )
    counter: str | None = Field(
        None,
        description=(
            "Unsigned field that counts up by one each frame, by which lost and repeated frames "
            "are found; null for none."
        ),
    )
    checksum: ChecksumField | None = Field(
        None,
        description=(
            "Checksum that follows the fields; a frame whose checksum is wrong is rejected. Null "
            "for none."
        ),
    )

    _once = field_validator("fields")(_named_once)

    @property
    def layout(self) -> str:
        """Return the struct format of sync, fields and checksum."""
        layout = "<" if self.byte_order == "little" else ">"
        layout += f"{len(bytes.fromhex(self.sync))}x"
        return layout + "".join(STRUCT[field.type] for field in self.fields)

    @property
    def checksum_at(self) -> int:
        """Return the place of the checksum, or of the end bytes."""
        return len(bytes.fromhex(self.sync)) + sum(SIZE[field.type] for field in self.fields)

    @property
    def size(self) -> int:
        """Return the length of a frame."""
        extra = 0 if self.checksum is None else checksum(self.checksum.kind)[1]
        return self.checksum_at + extra + len(bytes.fromhex(self.end))

    @model_validator(mode="after")
    def _consistent(self) -> BinaryFormat:
        counting = [field.name for field in self.fields if field.type[0] == "u"]
        if self.counter is not None and self.counter not in counting:
            raise ValueError("counter must name an unsigned field")
        if self.checksum is not None and self.checksum.span is not None:
            first, last = self.checksum.span
            if not 0 <= first < last <= self.checksum_at:
                raise ValueError(f"span must lie within bytes 0 to {self.checksum_at}")
        return self


class TextField(Section):
    """One field of a text line: a group of the pattern; value = number * scale, in `unit`."""

    name: str = Field(
        min_length=1,
        pattern=r"^[A-Za-z_][A-Za-z0-9_]*$",
        description="Name of the field, and of the pattern's group that holds it.",
    )
    scale: AnySize = Field(1.0, description="Factor: value = number * scale.")
    unit: str = Field(
        "1",
        description=(
            "Unit of the value, such as N or kg; a unit other than the rig's needs a scale in the "
            "rig's file."
        ),
    )


class TextFormat(Section):
    """Lines of ASCII, each matched whole by a regular expression with a group per field."""

    kind: Literal["text"] = Field(description="Lines of ASCII text.")
    pattern: str = Field(
        description=(
            "Regular expression that must match the whole line, with a group (?P<name>...) for "
            "each field."
        )
    )
    fields: tuple[TextField, ...] = Field(
        min_length=1, max_length=16, description="Fields of the line."
    )
    longest_line: int = Field(
        80,
        ge=2,
        le=1000,
        description="Longest line that is accepted, in bytes; a longer one is dropped.",
    )

    _once = field_validator("fields")(_named_once)

    @model_validator(mode="after")
    def _groups(self) -> TextFormat:
        try:
            groups = set(re.compile(self.pattern).groupindex)
        except re.error as error:
            raise ValueError(f"pattern is no regular expression: {error}") from None
        missing = {field.name for field in self.fields} - groups
        if missing:
            raise ValueError(f"the pattern has no group (?P<{min(missing)}>...)")
        return self


Format = BinaryFormat | TextFormat
_KINDS: dict[object, type[Format]] = {"binary": BinaryFormat, "text": TextFormat}


def load_format(name: str) -> Format:
    """Read a format: a path, or the name of a file of this package's formats folder.

    Raises AxisError with file, line and key of everything wrong in it.
    """
    path = Path(name)
    if not path.is_file():
        path = Path(str(resources.files("teleop_rt_drivers") / "formats" / f"{name}.yaml"))
    if not path.is_file():
        shipped = sorted(file.stem for file in path.parent.glob("*.yaml"))
        raise AxisError(f"frame format {name!r} is neither a file nor one of: {', '.join(shipped)}")
    try:
        document = read_yaml(path)
    except ConfigError as error:
        raise AxisError(f"frame format: {error}") from None
    kind = document.data.get("kind") if isinstance(document.data, dict) else None
    if kind not in _KINDS:
        raise AxisError(f"{document.place(('kind',))}: kind: {kind!r}: write binary or text")
    try:
        return _KINDS[kind].model_validate(document.data)
    except ValidationError as error:
        schema = _KINDS[kind]
        problems = [str(problem_of(schema, document, (), None, d)) for d in error.errors()]
        raise AxisError("\n".join(problems)) from None
