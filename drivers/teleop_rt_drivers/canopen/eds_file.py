"""Problems of an EDS file, with line and key, found before anything is built from it.

The canopen package reads the file, but reports problems without their place, or not at all.
"""

from __future__ import annotations

import configparser
import re
from collections.abc import Callable

from teleop_rt.axis import AxisError

OBJECT = re.compile(r"^[0-9A-Fa-f]{4}(sub[0-9A-Fa-f]+)?$")
NUMBER = re.compile(r"^(\$NODEID\s*\+?\s*)?[+-]?(0[xX][0-9A-Fa-f]+|\d+)?(\s*\+\s*\$NODEID)?$")
ACCESS = ("ro", "wo", "rw", "rwr", "rww", "const")
LISTS = ("MandatoryObjects", "OptionalObjects", "ManufacturerObjects")
MANDATORY = "DeviceInfo"
_CORRECT = "correct it, or get the EDS again from the device's maker"
VARIABLE, DOMAIN = 0x7, 0x2  # ObjectType (CiA 306)
NUMERIC = ("ObjectType", "DataType", "SubNumber", "PDOMapping")
BITS = {0x02: 8, 0x03: 16, 0x04: 32, 0x05: 8, 0x06: 16, 0x07: 32, 0x15: 64, 0x1B: 64}
"""Bits of each whole number's data type (CiA 301)."""
SIGNED = (0x02, 0x03, 0x04, 0x15)  # data types: INTEGER8, 16, 32 and 64 (CiA 301)

Places = dict[tuple[str, str], int]
Refuse = Callable[[str, str], AxisError]


def check(text: str, name: str) -> None:
    """Refuse a file with impossible objects; AxisError names file, line and key."""
    parser = configparser.RawConfigParser(inline_comment_prefixes=(";",))
    parser.optionxform = str  # type: ignore[method-assign,assignment]  # keys keep their case
    try:
        parser.read_string(text)
    except configparser.Error as error:
        raise AxisError(_syntax(error, name)) from error
    if not parser.has_section(MANDATORY):
        raise AxisError(
            f"{name}:1: the section [{MANDATORY}] is missing: get the complete EDS from the maker"
        )
    places = _places(text)
    for section in parser.sections():
        if OBJECT.match(section):
            _check_object(parser, section, name, places)
    for section in LISTS:
        if parser.has_section(section):
            _check_list(parser, section, name, places)


def _syntax(error: configparser.Error, name: str) -> str:
    """Return a message with the place and the text of the first line that is not of an EDS."""
    wrong: list[tuple[int, str]] = getattr(error, "errors", [])
    if wrong:
        line, content = wrong[0]
        return f"{name}:{line}: {content} is neither a section nor a key"
    line = getattr(error, "lineno", 1)
    if isinstance(error, configparser.DuplicateOptionError):
        return f"{name}:{line}: [{error.section}] {error.option}: is listed twice"
    if isinstance(error, configparser.DuplicateSectionError):
        return f"{name}:{line}: [{error.section}]: is listed twice"
    return f"{name}:{line}: is no EDS: {error}".replace("\n", " ")


def _places(text: str) -> Places:
    """Return the line of each key, and under the key "" that of each section."""
    places: Places = {}
    section = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if found := re.match(r"\s*\[([^]]*)\]", line):
            section = found.group(1)
            places[section, ""] = number
        elif "=" in line:
            places[section, line.partition("=")[0].strip()] = number
    return places


def _check_object(
    parser: configparser.RawConfigParser, section: str, name: str, places: Places
) -> None:
    def refuse(key: str, why: str) -> AxisError:
        line = places.get((section, key), places[section, ""])
        return AxisError(f"{name}:{line}: [{section}] {key}: {why}: {_CORRECT}")

    keys = dict(parser.items(section))
    if "ParameterName" not in keys:
        raise refuse("ParameterName", "is missing")
    for key in NUMERIC:
        if key in keys and _number(keys[key]) is None:
            raise refuse(key, f"{keys[key]!r} is no number")
    kind = _number(keys.get("ObjectType", "7"))
    if kind not in (VARIABLE, DOMAIN):
        return
    data_type = _number(keys.get("DataType", "0xF" if kind == DOMAIN else ""))
    if data_type is None:
        raise refuse("DataType", "is missing")
    if keys.get("AccessType", "rw").lower() not in ACCESS:
        raise refuse("AccessType", f"{keys['AccessType']!r} is not one of {', '.join(ACCESS)}")
    for key in ("DefaultValue", "LowLimit", "HighLimit"):
        if data_type in BITS and (value := keys.get(key, "").strip()):
            _check_value(refuse, key, value, data_type)


def _check_value(refuse: Refuse, key: str, value: str, data_type: int) -> None:
    """Refuse a value that is not a number, or one beyond the object's type."""
    if not NUMBER.match(value):
        raise refuse(key, f"{value!r} is no number")
    number, bits = _number(value), BITS[data_type]
    if number is None:
        return  # an expression of $NODEID
    lowest = -(1 << bits - 1) if data_type in SIGNED else 0
    if not lowest <= number < 1 << bits:
        raise refuse(key, f"{value} does not fit into {bits} bits")


def _check_list(
    parser: configparser.RawConfigParser, section: str, name: str, places: Places
) -> None:
    """Refuse a list of objects that names one which the file does not describe."""
    described = {title.upper() for title in parser.sections()}
    for key, value in parser.items(section):
        if not key.isdigit():
            continue
        index = _number(value)
        if index is None or f"{index:04X}" not in described:
            line = places.get((section, key), 1)
            raise AxisError(
                f"{name}:{line}: [{section}] {key}: the file has no section for {value}: {_CORRECT}"
            )


def _number(text: str) -> int | None:
    try:
        return int(text, 0)
    except ValueError:
        return None
