"""Words for a value of a config that is of the wrong type, form or length."""

from __future__ import annotations

import difflib
import re

from pydantic_core import ErrorDetails

_DECIMAL_COMMA = re.compile(r"([-+]?\d+),(\d+)")
_WITH_UNIT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)\s*[a-zA-Zµ°]\S*")
_NUMBERS = {"float_type": "a number", "int_type": "a whole number"}
_TYPES = {
    "tuple_type": "a list",
    "bool_type": "true or false",
    "dict_type": "a section",
    "string_type": "text",
}
_LENGTHS = {
    "too_short": "must have at least {min_length} {item} (it is {shown})",
    "too_long": "must have at most {max_length} {item} (it is {shown})",
    "string_too_short": "must not be empty: write at least {min_length} {character}",
    "string_too_long": "must have at most {max_length} {character} (it is {shown})",
}
PATTERNS = {
    r"^[A-Za-z0-9_-]+$": "consist of letters, digits, _ and - alone",
    r"^[A-Za-z_][A-Za-z0-9_]*$": "consist of letters, digits and _, and begin with no digit",
    r"^0x[0-9A-Fa-f]{4}(:[0-9]{1,3})?$": "name an entry by index and subindex, such as 0x6064:0",
}
"""Form of the text that a pattern accepts, behind `must`."""


def wrong_value(detail: ErrorDetails) -> str:
    """Return the demand on a value, and the value; with a hint where the slip can be seen."""
    kind, given, shown = detail["type"], detail["input"], in_short(detail["input"])
    if kind in _TYPES:
        scalar = kind == "string_type" and isinstance(given, bool | int | float)
        quotes = ": put it in quotes" if scalar else ""
        return f"must be {_TYPES[kind]} (it is {shown}){quotes}"
    if kind in _LENGTHS:
        return _wrong_length(_LENGTHS[kind], detail, shown)
    if kind == "string_pattern_mismatch":
        pattern = detail["ctx"]["pattern"]
        wanted = PATTERNS.get(pattern, f"match {pattern}")
        return f"must {wanted} (it is {shown})"
    if kind in _NUMBERS:
        return _no_number(_NUMBERS[kind], given)
    if kind == "literal_error" and isinstance(given, str):
        return _wrong_name(detail["ctx"]["expected"], given)
    message = detail["msg"].removeprefix("Value error, ").replace("Input should be", "must be")
    return message if isinstance(given, dict) else f"{message} (it is {shown})"


def _wrong_length(words: str, detail: ErrorDetails, shown: str) -> str:
    one = 1 in (detail["ctx"].get("min_length"), detail["ctx"].get("max_length"))
    item, character = ("item", "character") if one else ("items", "characters")
    return words.format(item=item, character=character, shown=shown, **detail["ctx"])


def _no_number(wanted: str, given: object) -> str:
    """Say that a number is needed, and how a decimal comma is to be written."""
    comma = _DECIMAL_COMMA.fullmatch(given) if isinstance(given, str) else None
    hint = f": use a point for decimals, {comma[1]}.{comma[2]}" if comma else ""
    if isinstance(given, str) and _WITH_UNIT.fullmatch(given):
        hint = ": write the number alone, without its unit"
    return f"must be {wanted} (it is {in_short(given)}){hint}"


def _wrong_name(expected: str, given: str) -> str:
    """Say which names there are, and the one that may have been meant."""
    near = difflib.get_close_matches(given, re.findall(r"'([^']+)'", expected), n=1)
    hint = f": did you mean {near[0]!r}?" if near else ""
    return f"must be {expected} (it is {in_short(given)}){hint}"


def in_short(value: object) -> str:
    """Return a value as its file has it: lists in brackets, `empty` for none, and not too long."""
    try:
        text = "empty" if value is None else repr(_written(value))
    except ValueError:  # a whole number of more digits than Python writes down
        return "a number of thousands of digits"
    return text if len(text) <= 60 else f"{text[:57]}..."


def _written(value: object) -> object:
    return [_written(item) for item in value] if isinstance(value, tuple) else value
