"""JSON Schema (draft 2020-12) of the YAML files, made from the models that load them.

Keys carry the rig's unit, so a schema holds each section that depends on it twice, for a linear
and for a rotary rig, and a condition at the top says which of the two a file must follow.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema, core_schema

from teleop_rt.config.loader import FILES, dump
from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.rig import RigConfig
from teleop_rt.config.section import Section, Units
from teleop_rt.config.trial import TrialConfig
from teleop_rt.json_schema import DIALECT

Schema = dict[str, Any]
Parts = Mapping[type[Section], tuple[type[Section], ...]]
"""The sections of which each driver has its own kind, with the kinds that may stand there."""

LINEAR, ROTARY = Units(position="m", force="N"), Units(position="rad", force="Nm")
_DEFS = "#/$defs/"
_HOLDERS: Mapping[tuple[str, ...], type[Section]] = {
    (): TrialConfig,
    ("operator",): DeviceOperator,
}
"""The section that holds each key in the place of which a file may be named."""


def schema_of_rig(parts: Parts) -> Schema:
    """Return the JSON Schema of a rig's file."""
    rotary = {"properties": {"units": _having({"position": {"const": ROTARY.position}})}}
    return _in_both_units(RigConfig, parts, rotary)


def schema_of_trial(parts: Parts) -> Schema:
    """Return the JSON Schema of a trial's file, which names its rig or holds it.

    Where it names the rig, the unit of contact.onset_force says which kind of rig that must be.
    """
    units = _having({"position": {"const": ROTARY.position}})
    holds = {"properties": {"rig": _having({"units": units})}, "required": ["rig"]}
    onset = {"type": "object", "required": [f"onset_force_{ROTARY.force}"]}
    names = {"properties": {"contact": onset}, "required": ["contact"]}
    return _in_both_units(TrialConfig, parts, {"anyOf": [holds, names]})


def schema_of(*models: type[BaseModel]) -> Schema:
    """Return the JSON Schema of a model whose keys depend on no rig, or of any one of several."""
    roots, defs = _SectionSchema({}, LINEAR).roots_and_defs(models)
    if len(roots) == 1:
        return {"$schema": DIALECT} | defs.pop(roots[0]) | {"$defs": defs}
    kinds = [{"$ref": f"{_DEFS}{root}"} for root in roots]
    return {"$schema": DIALECT, "oneOf": kinds, "$defs": defs}


def _having(properties: Schema) -> Schema:
    return {"type": "object", "properties": properties, "required": list(properties)}


def _described(model: type[BaseModel]) -> Schema:
    text = " ".join((model.__doc__ or "").split("\n\n")[0].split())
    return {"title": model.__name__, "description": text}


def _in_both_units(model: type[Section], parts: Parts, rotary: Schema) -> Schema:
    """Return the schema of a file that follows its rotary form where `rotary` holds of it."""
    forms = {units.position: _SectionSchema(parts, units) for units in (LINEAR, ROTARY)}
    made = {suffix: form.roots_and_defs([model]) for suffix, form in forms.items()}
    defs = _merged({suffix: defs for suffix, (_, defs) in made.items()})
    linear, turning = ({"$ref": f"{_DEFS}{root}_{suffix}"} for suffix, ([root], _) in made.items())
    both = {"if": rotary, "then": turning, "else": linear, "$defs": defs}
    return {"$schema": DIALECT} | _described(model) | both


def _merged(forms: Mapping[str, dict[str, Schema]]) -> Schema:
    """Return the definitions of all forms: once where they agree, else with the form's suffix."""
    first, second = forms.values()
    differ = {name for name in first | second if first.get(name) != second.get(name)}
    while more := {
        name for name, body in first.items() if name not in differ and _references(body) & differ
    }:
        differ |= more
    merged: Schema = {}
    for suffix, form in forms.items():
        for name, body in form.items():
            key = f"{name}_{suffix}" if name in differ else name
            merged[key] = _renamed(body, differ, suffix)
    return dict(sorted(merged.items()))


def _references(content: Any) -> set[str]:
    if isinstance(content, dict):
        named = content.get("$ref")
        own = {named.removeprefix(_DEFS)} if isinstance(named, str) else set()
        return own.union(*(_references(value) for value in content.values()))
    if isinstance(content, list):
        return set[str]().union(*(_references(value) for value in content))
    return set()


def _renamed(content: Any, differ: set[str], suffix: str) -> Any:
    """Return a copy whose references to definitions that differ carry the suffix."""
    if isinstance(content, dict):
        return {
            key: f"{value}_{suffix}"
            if key == "$ref" and value.removeprefix(_DEFS) in differ
            else _renamed(value, differ, suffix)
            for key, value in content.items()
        }
    if isinstance(content, list):
        return [_renamed(value, differ, suffix) for value in content]
    return content


def _core(model: type[BaseModel]) -> CoreSchema:
    """Return a model's core schema, built now where it was not needed before."""
    model.model_rebuild()
    return model.__pydantic_core_schema__


class _SectionSchema(GenerateJsonSchema):
    """Writes sections as a file has them: keys with units, drivers merged, files in their place."""

    def __init__(self, parts: Parts, units: Units) -> None:
        super().__init__()
        self._parts = parts
        self._rig_units = units

    def roots_and_defs(
        self, models: Sequence[type[BaseModel]]
    ) -> tuple[list[str], dict[str, Schema]]:
        """Return the names of the models' definitions, and all definitions."""
        several = core_schema.tuple_schema([_core(model) for model in models])
        generated = self.generate(several)
        roots = [item["$ref"].removeprefix(_DEFS) for item in generated["prefixItems"]]
        return roots, generated["$defs"]

    def model_schema(self, schema: core_schema.ModelSchema) -> Schema:
        """Return the schema of a section."""
        cls = schema["cls"]
        if cls in self._parts:
            kinds = [self.generate_inner(_core(kind)) for kind in self._parts[cls]]
            return {"oneOf": kinds} if len(kinds) > 1 else kinds[0]
        written = super().model_schema(schema)
        if cls is Units:
            for name, value in self._rig_units:
                written["properties"][name] |= {"const": value}
        if issubclass(cls, Section):
            self._as_in_a_file(cls, written)
        return written

    def _as_in_a_file(self, cls: type[Section], written: Schema) -> None:
        keys = {name: q.key(name, self._rig_units) for name, q in cls.quantities().items()}
        properties: Schema = {}
        for name, body in written.get("properties", {}).items():
            properties[keys.get(name, name)] = body
            # pydantic leaves it out where it is that of the section that stands there.
            body.setdefault("description", cls.model_fields[name].description)
        for keys_of_file in FILES:
            if cls is _HOLDERS[keys_of_file[:-1]]:
                _allow_a_path(properties[keys_of_file[-1]])
        written["properties"] = properties
        if required := written.get("required"):
            written["required"] = [keys.get(name, name) for name in required]

    def float_schema(self, schema: core_schema.FloatSchema) -> Schema:
        """Return a number's schema with one bound on either side: the tighter of two."""
        written = super().float_schema(schema)
        if written.get("exclusiveMinimum", -math.inf) >= written.get("minimum", -math.inf):
            written.pop("minimum", None)
        if written.get("exclusiveMaximum", math.inf) <= written.get("maximum", math.inf):
            written.pop("maximum", None)
        return written

    def tagged_union_schema(self, schema: core_schema.TaggedUnionSchema) -> Schema:
        """Return a union by its tag, without the discriminator that only OpenAPI knows."""
        written = super().tagged_union_schema(schema)
        written.pop("discriminator", None)
        return written

    def field_title_should_be_set(self, schema: object) -> bool:  # noqa: ARG002 - pydantic's signature
        """Return false: a title would repeat the key."""
        return False

    def encode_default(self, dft: Any) -> Any:
        """Return a default value with the keys of a file."""
        return (
            dump(dft, self._rig_units) if isinstance(dft, Section) else super().encode_default(dft)
        )


def _allow_a_path(body: Schema) -> None:
    """Let a section's place hold the path of a file instead."""
    kinds = body.pop("anyOf", None) or [{"$ref": body.pop("$ref")}]
    body["anyOf"] = [{"type": "string", "minLength": 1}, *kinds]
