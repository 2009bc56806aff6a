"""Tables of keys from a JSON Schema: key, type, bounds, default, meaning."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

Schema = dict[str, Any]
Row = tuple[str, str, str, str, str]

HEADER = ("key", "type", "bounds", "default", "meaning")
_BOUNDS = {
    "exclusiveMinimum": "> {:.9g}",
    "minimum": "≥ {:.9g}",
    "exclusiveMaximum": "< {:.9g}",
    "maximum": "≤ {:.9g}",
}
_TYPES = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "true or false",
    "null": "null",
    "object": "mapping",
}
_DEFS = "#/$defs/"


@dataclass(frozen=True, slots=True)
class KeySection:
    """One section of a file: the file's own key above it (empty for the file), and its keys."""

    root: str
    heading: str
    meaning: str
    rows: list[Row]


def sections(schema: Schema, without: frozenset[str] = frozenset()) -> Iterator[KeySection]:
    """Yield each section once, the file's own first; `without` are keys of the file to leave out.

    Of a schema in both units the linear form is shown.
    """
    defs = schema.get("$defs", {})
    waiting = [("", "", schema)]
    seen: set[str] = set()
    while waiting:
        root, path, body = waiting.pop(0)
        for section in _objects(body, defs):
            title = section.get("title", "")
            if title in seen or "properties" not in section:
                continue
            seen.add(title)
            required = section.get("required", ())
            rows = [
                _row(key, value, key in required, defs)
                for key, value in section["properties"].items()
            ]
            heading = f"{path} ({title})" if path else title
            yield KeySection(root, heading, section.get("description", ""), rows)
            waiting += [
                (root or key, f"`{key}`", value)
                for key, value in section["properties"].items()
                if root or key not in without
            ]


def _objects(body: Any, defs: Schema) -> Iterator[Schema]:
    """Yield the sections that may stand at a place."""
    if not isinstance(body, dict):
        return
    if "$ref" in body:
        yield from _objects(defs[body["$ref"].removeprefix(_DEFS)], defs)
        return
    if "else" in body:
        yield from _objects(body["else"], defs)
    if "properties" in body:
        yield body
    for key in ("anyOf", "oneOf", "prefixItems"):
        for kind in body.get(key, ()):
            yield from _objects(kind, defs)
    for key in ("items", "additionalProperties"):
        yield from _objects(body.get(key), defs)


def _row(key: str, body: Schema, required: bool, defs: Schema) -> Row:
    default = "required" if required else f"`{json.dumps(body.get('default'), ensure_ascii=False)}`"
    if isinstance(body.get("default"), dict) and body["default"]:
        default = "its own defaults"
    meaning = body.get("description", "")
    return f"`{key}`", _kind(body, defs), _bounds(body), default, meaning


def _kind(body: Schema, defs: Schema) -> str:  # noqa: PLR0911 - one answer per kind of schema
    """Return the type of a value in words."""
    if "$ref" in body:
        found = defs[body["$ref"].removeprefix(_DEFS)]
        if "properties" in found:
            return f"section {found['title']}"
        return _kind(found, defs)
    if "const" in body:
        return f"`{body['const']}`"
    if "enum" in body:
        return ", ".join(f"`{value}`" for value in body["enum"])
    kinds = [*body.get("anyOf", ()), *body.get("oneOf", ())]
    if kinds:
        return " or ".join(dict.fromkeys(_kind(kind, defs) for kind in kinds))
    if body.get("type") == "array":
        items = [body["items"]] if "items" in body else body.get("prefixItems", [])
        inner = ", ".join(dict.fromkeys(_kind(item, defs) for item in items))
        return f"list of {inner or 'anything'}"
    values = body.get("additionalProperties")
    if body.get("type") == "object" and isinstance(values, dict):
        return f"mapping to {_kind(values, defs)}"
    kinds = body.get("type", "anything")
    several = kinds if isinstance(kinds, list) else [kinds]
    return " or ".join(_TYPES.get(name, name) for name in several)


def _bounds(body: Schema) -> str:
    of_kinds = [_bounds(kind) for kind in body.get("anyOf", ())]
    own = [text.format(body[name]) for name, text in _BOUNDS.items() if name in body]
    return ", ".join([*own, *dict.fromkeys(bounds for bounds in of_kinds if bounds)])
