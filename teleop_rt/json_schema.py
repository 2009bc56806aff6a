"""JSON Schema (draft 2020-12) of JSON that is printed, made from typed declarations of its keys."""

from __future__ import annotations

from typing import Any

from pydantic import ConfigDict, TypeAdapter
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import core_schema
from typing_extensions import TypedDict, get_original_bases, is_typeddict

DIALECT = "https://json-schema.org/draft/2020-12/schema"
"""The dialect that a schema names."""


class Keys(TypedDict):
    """Keys of a JSON object that holds no others; the text below each describes it."""

    __pydantic_config__ = ConfigDict(  # type: ignore[misc] # pydantic's way for a TypedDict
        extra="forbid", use_attribute_docstrings=True
    )


class _KeysSchema(GenerateJsonSchema):
    """Writes keys without titles, which would repeat them, and those of a base with its texts."""

    def typed_dict_schema(self, schema: core_schema.TypedDictSchema) -> dict[str, Any]:
        """Return the schema of `Keys`; pydantic reads no text of a base by itself."""
        written = super().typed_dict_schema(schema)
        for base in filter(is_typeddict, get_original_bases(schema["cls"])):
            for name, body in schema_of_json(base).get("properties", {}).items():
                written["properties"][name].setdefault("description", body["description"])
        return written

    def field_title_should_be_set(self, schema: object) -> bool:  # noqa: ARG002 - pydantic's signature
        """Return false."""
        return False


def schema_of_json(form: Any) -> dict[str, Any]:
    """Return the JSON Schema of a form: `Keys`, or a union of several."""
    return {"$schema": DIALECT} | TypeAdapter[Any](form).json_schema(schema_generator=_KeysSchema)
