"""Problems of a config, reported by the keys, bounds and values of its file."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence
from typing import Any

from pydantic_core import ErrorDetails

from teleop_rt.config.contradictions import ContradictionError
from teleop_rt.config.section import MissingUnit, Section, Units
from teleop_rt.config.value_words import in_short, wrong_value
from teleop_rt.config.yaml_file import ConfigProblem, Document, KeyPath

_ONE = r"[num\u00b5]?(?:m|s|N|Nm|rad)|k(?:N|Nm|Hz|hz)|cm|deg|rev|min|hz|Hz|kg|in|lbf"
_UNIT = re.compile(rf"(.+?)_((?:{_ONE})(?:_s)?(?:_per_(?:{_ONE}))?)")
"""A key that ends with a unit, also a foreign one: its name and that unit."""

_DOTTED = re.compile(r"[a-z_]+(?:\.[a-z_]+)+")
"""A key that a contradiction names in its sentence."""


def follows_from_others(
    schema: type[Section], units: Units | None, detail: ErrorDetails, details: list[ErrorDetails]
) -> bool:
    """Return whether a key is missing because it is misspelt, or a list short of invalid items."""
    loc = detail["loc"]
    if detail["type"] == "missing":
        unknown = (other["loc"] for other in details if other["type"] == "extra_forbidden")
        return any(
            other[:-1] == loc[:-1] and _key_at(schema, loc, units) == _meant(schema, other, units)
            for other in unknown
        )
    return detail["type"] == "too_short" and any(
        len(other["loc"]) > len(loc) and other["loc"][: len(loc)] == loc for other in details
    )


def problems_of(
    schema: type[Section],
    document: Document,
    path: KeyPath,
    units: Units | None,
    detail: ErrorDetails,
) -> list[ConfigProblem]:
    """Return a problem, or one for each contradiction between sections, at the key it names."""
    error = detail.get("ctx", {}).get("error")
    if not isinstance(error, ContradictionError):
        return [problem_of(schema, document, path, units, detail)]
    above = (*path, *detail["loc"])
    return [
        _contradiction(schema, document, above, len(path), units, sentence)
        for sentence in error.found
    ]


def _contradiction(
    schema: type[Section],
    document: Document,
    above: KeyPath,
    skip: int,
    units: Units | None,
    sentence: str,
) -> ConfigProblem:
    """Say a contradiction with the keys of the file, at the first key that it names."""
    locations: list[KeyPath] = []

    def written(key: str) -> str:
        location = _written_keys(document, (*above, *key.split(".")), schema, skip, units)
        locations.append(location)
        return ".".join(map(str, location))

    first, said = sentence.split(" ", 1)
    name = written(first.rstrip(":"))
    said = _DOTTED.sub(lambda key: written(key[0]), said)
    return ConfigProblem(document.origin(locations), f"{name}: {said}")


def problem_of(
    schema: type[Section],
    document: Document,
    path: KeyPath,
    units: Units | None,
    detail: ErrorDetails,
) -> ConfigProblem:
    """Describe a mistake in the words of the file: its own keys, bounds and allowed values."""
    location = _written_keys(document, (*path, *detail["loc"]), schema, len(path), units)
    name = ".".join(map(str, location)) or "this file"
    if isinstance(detail["input"], MissingUnit):
        message = f"the key lacks its unit: write {detail['input'].key}"
    elif detail["type"] == "extra_forbidden":
        message = _unknown_key(schema, detail["loc"], units)
    elif detail["type"] == "missing":
        message = "is required and missing"
    elif detail["type"] in {"union_tag_invalid", "union_tag_not_found"}:
        message = _wrong_tag(schema, detail)
    elif detail["type"] in {"model_type", "model_attributes_type"}:
        message = _no_section(schema, detail, units)
    else:
        message = wrong_value(detail) + _inverted(schema, detail)
    kind = _kind_of_item(schema, detail["loc"])
    of_all = detail["type"] == "value_error"
    if detail["type"] == "union_tag_invalid":  # the place of the key, not that of its section
        location = (*location, detail["ctx"]["discriminator"].strip("'"))
    where = document.origin([location]) if of_all else document.place(location)
    return ConfigProblem(where, f"{name}{kind}: {message}")


def _inverted(schema: type[Section], detail: ErrorDetails) -> str:
    """Return how a direction is inverted where a scale below 0 was to do it, else nothing."""
    loc, given = detail["loc"], detail["input"]
    if loc[-1:] != ("scale",) or not isinstance(given, int | float) or not given < 0:
        return ""
    signed = any("sign" in section.model_fields for section in _section_at(schema, loc[:-1]))
    return f": for the other direction write sign: -1 beside {-given:g}" if signed else ""


def _no_section(schema: type[Section], detail: ErrorDetails, units: Units | None) -> str:
    """Say that a section is needed: of which kinds, or with which keys."""
    given, sections = in_short(detail["input"]), _section_at(schema, detail["loc"])
    for key in sections[0].model_fields if len(sections) > 1 else ():
        kinds = [_discriminator(s, key) if key in s.model_fields else None for s in sections]
        if None not in kinds:
            one_of = ", ".join(map(str, kinds))
            return f"must be a section with the key {key}, one of: {one_of} (it is {given})"
    keys = ", ".join(_known_keys(schema, detail["loc"], units)) or "its own"
    return f"must be a section, with keys of {keys} (it is {given})"


def _wrong_tag(schema: type[Section], detail: ErrorDetails) -> str:
    """Say which key must name one of which kinds, and the one that may have been meant."""
    key = detail["ctx"]["discriminator"].strip("'")
    tags = [
        _discriminator(s, key) for s in _section_at(schema, detail["loc"]) if key in s.model_fields
    ]
    known = [str(tag) for tag in tags if tag is not None]
    if detail["type"] == "union_tag_not_found":
        return f"names no {key}: add {key}, one of: {', '.join(known)}"
    # Drivers of parts are known at run time only: pydantic lists them, our sections do not.
    known = known or re.findall(r"'([^']+)'", detail["ctx"]["expected_tags"])
    given = detail["ctx"]["tag"]
    near = difflib.get_close_matches(given, known, n=1)
    return f"{key}: there is no {given!r}; " + (
        f"did you mean {near[0]!r}?" if near else f"one of: {', '.join(known)}"
    )


def _kind_of_item(schema: type[Section], loc: tuple[str | int, ...]) -> str:
    """Return in brackets of which kind the item of a list is that a location leads through."""
    for depth in range(1, len(loc)):
        if isinstance(loc[depth - 1], int) and _is_tag(
            _section_at(schema, loc[:depth]), loc[depth]
        ):
            return f" ({loc[depth]})"
    return ""


def _is_tag(sections: list[type[Section]], key: str | int) -> bool:
    """Return whether a key of a location is pydantic's tag for the member of a union."""
    return any(_discriminator(s, name) == key for s in sections for name in s.model_fields)


def _section_at(schema: type[Section], loc: Sequence[str | int]) -> list[type[Section]]:
    """Return the sections that a location inside `schema` may lie in (several for a union)."""
    sections: list[type[Section]] = [schema]
    for key in loc:
        found: list[type[Section]] = []
        for section in sections:
            field = section.model_fields.get(str(key))
            if isinstance(key, int):
                found.append(section)
            elif field is not None:
                found += _sections_in(field.annotation)
            elif any(key == _discriminator(section, name) for name in section.model_fields):
                found.append(section)
        sections = found
    return sections


def _discriminator(section: type[Section], name: str) -> object:
    """Return the one value of a Literal field, which identifies the member of a union."""
    arguments: tuple[object, ...] = getattr(section.model_fields[name].annotation, "__args__", ())
    return arguments[0] if len(arguments) == 1 else None


def _sections_in(annotation: Any) -> list[type[Section]]:
    if isinstance(annotation, type) and issubclass(annotation, Section):
        return [annotation]
    found: list[type[Section]] = []
    for argument in getattr(annotation, "__args__", ()):
        found += _sections_in(argument)
    return found


def _key_of(section: type[Section], name: str, units: Units | None) -> str:
    quantity = section.quantities().get(name)
    return quantity.key(name, units) if quantity and units else name


def _written_keys(
    document: Document,
    location: KeyPath,
    schema: type[Section],
    skip: int,
    units: Units | None,
) -> KeyPath:
    """Turn field names into the keys of the file, and drop pydantic's additions for unions."""
    written: list[str | int] = list(location[:skip])
    for depth in range(skip, len(location)):
        key = location[depth]
        sections = _section_at(schema, location[skip:depth])
        if (*written, key) not in document.places:
            if _is_tag(sections, key):
                continue
            for section in sections:
                if str(key) in section.model_fields:
                    key = _key_of(section, str(key), units)
                    break
        written.append(key)
    return tuple(written)


def _known_keys(
    schema: type[Section], loc: Sequence[str | int], units: Units | None
) -> dict[str, None]:
    """Return the keys of a file that the section at a location may have, in order."""
    keys = (
        _key_of(section, name, units)
        for section in _section_at(schema, loc)
        for name in section.model_fields
    )
    return dict.fromkeys(sorted(keys))


def _key_at(schema: type[Section], loc: Sequence[str | int], units: Units | None) -> str:
    """Return the key of a file for the field at a location."""
    for section in _section_at(schema, loc[:-1]):
        if loc[-1] in section.model_fields:
            return _key_of(section, str(loc[-1]), units)
    return str(loc[-1])


def _meant(schema: type[Section], loc: Sequence[str | int], units: Units | None) -> str | None:
    """Return the known key that an unknown one is nearest to, or None."""
    known = _known_keys(schema, loc[:-1], units)
    return next(iter(difflib.get_close_matches(str(loc[-1]), known, n=1)), None)


def _unknown_key(schema: type[Section], loc: Sequence[str | int], units: Units | None) -> str:
    near = _meant(schema, loc, units)
    if near is None:
        return f"unknown key; known keys: {', '.join(_known_keys(schema, loc[:-1], units))}"
    (given, other), (meant, unit) = (_parted(key) for key in (str(loc[-1]), near))
    convert = (
        f" Its value is in {unit}: convert it" if given == meant and other and other != unit else ""
    )
    return f"unknown key; did you mean {near!r}?{convert}"


def _parted(key: str) -> tuple[str, str]:
    """Return a key's name and the unit that it ends with, empty where it ends with none."""
    found = _UNIT.fullmatch(key)
    return (found[1], found[2]) if found else (key, "")
