"""Sections of a config file, and keys that carry the rig's unit.

A rig declares its units of position and force; a key whose unit depends on them ends in the rig's
own (`position_max_m` on a linear rig, `position_max_rad` on a rotary one). In Python the same field
has no suffix (`position_max`) and is in the rig's unit.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal, Self, cast

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationInfo,
    model_validator,
)
from pydantic_core import core_schema

LEAST, MOST = 1e-12, 1e12
"""Of any quantity in SI: from picometres and piconewtons to more than any machine has."""

MOST_OF = {
    "{x}": 1e3,  # 1 km; 159 turns of a drum
    "{x}_per_s": 1e3,  # the tip of a centrifuge; 9500 turns a minute
    "{x}_per_s2": 1e5,  # 10 000 g
    "{f}": 1e6,  # the largest presses of a laboratory: 100 t
    "{f}_per_s": 1e9,  # that force in a millisecond
    "{f}_per_{x}": 1e10,  # a block of steel has 1e9 N/m
    "{f}_s_per_{x}": 1e7,
    "{f}_s2_per_{x}": 1e5,  # 100 t
    "{f}_s2_per_{x}2": 1e8,
    "{x}_per_{f}": 1.0,  # a spring of 1 N/m is a thread of rubber
    "{x}_per_count": 10.0,  # one count a turn
    "{f}_per_count": 1e4,
    "{x}_per_unit": 1e3,  # a unit of 1 km
    "{f}_per_unit": 1e6,  # a unit of 1 MN
}
"""Largest size of a quantity of each unit, of either sign: beyond it a number is a slip."""

PositionUnit = Literal["m", "rad"]
ForceUnit = Literal["N", "Nm"]


class Quantity:
    """Annotation of a field whose key ends in the rig's unit; {x} and {f} represent the units.

    It bounds the field by the range that machines have (MOST_OF), beside the bounds of its own.
    """

    def __init__(self, suffix: str) -> None:
        self.suffix = suffix

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> core_schema.CoreSchema:
        """Return the field's schema, bounded where it has no bound of its own on that side.

        A plain `Ge` beside the field's own replaces it, and a damping of -5 is accepted.
        """
        schema, most = handler(source), MOST_OF[self.suffix]
        number: dict[str, Any] = dict(schema["schema"] if schema["type"] == "nullable" else schema)
        number.setdefault("le", most)
        if "gt" not in number:
            number.setdefault("ge", -most)
        bounded = cast("core_schema.CoreSchema", number)
        return core_schema.nullable_schema(bounded) if schema["type"] == "nullable" else bounded

    def key(self, name: str, units: Units) -> str:
        """Return the YAML key of the field `name` on a rig with these units."""
        return f"{name}_{units.fill(self.suffix)}"


Position = Annotated[float, Quantity("{x}")]
Velocity = Annotated[float, Quantity("{x}_per_s")]
Acceleration = Annotated[float, Quantity("{x}_per_s2")]
Force = Annotated[float, Quantity("{f}")]
ForceRate = Annotated[float, Quantity("{f}_per_s")]
Stiffness = Annotated[float, Quantity("{f}_per_{x}")]
Damping = Annotated[float, Quantity("{f}_s_per_{x}")]
Mass = Annotated[float, Quantity("{f}_s2_per_{x}")]
AnySize = Annotated[float, Field(ge=-MOST, le=MOST)]
"""A number of any unit, such as a fitted parameter's."""


class Units(BaseModel):
    """The rig's units of position and force: m and N, or rad and Nm."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    position: PositionUnit = Field(description="Unit of position: m on a linear rig, else rad.")
    force: ForceUnit = Field(description="Unit of force: N on a linear rig, else Nm.")

    @model_validator(mode="after")
    def _belong_together(self) -> Units:
        if (self.position == "rad") != (self.force == "Nm"):
            raise ValueError("position in m goes with force in N, position in rad with force in Nm")
        return self

    def fill(self, template: str) -> str:
        """Return `template` with {x} and {f} replaced by the units."""
        return template.replace("{x}", self.position).replace("{f}", self.force)


class MissingUnit:
    """Stands in for a value whose key was written without its unit; no field accepts it."""

    def __init__(self, key: str) -> None:
        self.key = key


class Section(BaseModel):
    """A part of a config file: unknown keys are refused, numbers are finite, values frozen.

    Values are taken as they are written (strict): text is no number, and `on` is no boolean.
    A section is built when it is first needed: most are, once, as a part of another.
    """

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True
    )

    @classmethod
    def quantities(cls) -> dict[str, Quantity]:
        """Return the fields whose key ends in a unit of the rig."""
        found = {}
        for name, field in cls.model_fields.items():
            for item in field.metadata:
                if isinstance(item, Quantity):
                    found[name] = item
        return found

    @model_validator(mode="after")
    def _of_sense(self) -> Self:
        """Refuse numbers that no machine has: they overflow, or vanish, in the first product."""
        for name in type(self).model_fields:
            for number in _numbers_in(getattr(self, name)):
                if number and not LEAST <= abs(number) <= MOST:
                    raise ValueError(
                        f"{name} is {number:g}: give a number between {LEAST:g} and {MOST:g}"
                    )
        return self

    @model_validator(mode="before")
    @classmethod
    def _strip_units(cls, data: Any, info: ValidationInfo) -> Any:
        """Rename `position_max_m` to `position_max`; a wrong unit stays, and is refused."""
        units = (info.context or {}).get("units")
        if units is None or not isinstance(data, dict):
            return data
        renamed = dict(data)
        for name, quantity in cls.quantities().items():
            key = quantity.key(name, units)
            if name in renamed:
                renamed[name] = MissingUnit(key)
                renamed.pop(key, None)  # the file's own key is right: one message is enough
            elif key in renamed:
                renamed[name] = renamed.pop(key)
        return renamed


def each_once(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return names of a list, of which none may stand twice. Raises ValueError."""
    twice = [name for place, name in enumerate(names) if name in names[:place]]
    if twice:
        raise ValueError(f"{twice[0]} is listed twice: list each once")
    return names


def _numbers_in(value: object) -> Iterator[float]:
    """Yield the numbers of a field, also those in its lists and mappings."""
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple):
        for item in value:
            yield from _numbers_in(item)
    elif isinstance(value, dict):
        yield from _numbers_in(tuple(value.values()))
