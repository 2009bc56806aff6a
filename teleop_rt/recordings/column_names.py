"""Names of columns: the quantity that a name states, and the units that it ends with."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping

from teleop_rt.contact.effect import Vector
from teleop_rt.recordings.units import UNITS

NEEDED = ("time", "position", "force")
"""Roles that a recording must have."""
_NAMES = {
    "time": {"t", "time", "timestamp"},
    "position": {"position", "pos", "x", "angle", "displacement"},
    "force": {"force", "f", "F", "torque"},
    "surface": {"surface"},
}
_SENSORS = {
    "time": {"elapsed", "elapsed_time", "datetime", "date/time", "zeit", "pr\u00fcfzeit"},
    "position": {"encoder", "stroke", "travel", "crosshead", "distance", "depth",
                 "indentation", "disp", "extension", "weg", "standardweg"},
    "force": {"load", "load_cell", "loadcell", "fz", "kraft", "standardkraft"},
}  # fmt: skip
"""Names that are taken for a role where no column has a name of the quantity itself."""
_NUMBERED = re.compile(r" \(column \d+\)$")  # of names that a table has more than once
_STRUCTURE = re.compile(r"^\w+\.(?=[^\W\d])")  # of MATLAB: log.time is a field of log
_AXES = {"x", "y", "z", "rx", "ry", "rz"}
"""Ends of names that state an axis and no unit."""


def columns_named(table: Mapping[str, Vector], role: str) -> list[str]:
    """Return the columns whose names fit the role: one, none, or several that each could be it.

    Where no whole name fits, the names of fields count without that of their structure.
    """
    own = {name: _NUMBERED.sub("", name) for name in table if table[name].size > 1}
    fields = {name: _STRUCTURE.sub("", word) for name, word in own.items()}
    return _fitting(own, role) or _fitting(fields, role)


def _fitting(own: Mapping[str, str], role: str) -> list[str]:
    """Return the columns that fit the role, by the word that names each."""
    plain = {name: without_units(word, role)[0] for name, word in own.items()}
    # A capital letter alone is another quantity (T a period), a capital in a word is not.
    plain = {
        name: word if len(word) == 1 else word.lower().replace(" ", "_")
        for name, word in plain.items()
    }
    known = [name for name, word in plain.items() if word in _NAMES.get(role, ())]
    known = known or [name for name, word in plain.items() if word in _SENSORS.get(role, ())]
    # A letter alone may be anything beside a word; one with a unit is as good as a word.
    return [name for name in known if len(plain[name]) > 1 or own[name] != plain[name]] or known


def is_plain(name: str, role: str) -> bool:
    """Return whether a column has a name of the role's own quantity, and not of a sensor of it."""
    word = without_units(_NUMBERED.sub("", name), role)[0]
    return (word if len(word) == 1 else word.lower().replace(" ", "_")) in _NAMES.get(role, ())


def without_units(name: str, role: str) -> tuple[str, list[str]]:
    """Return a name without the units that it ends with, the last first, and these units.

    x_mm, x [mm], x (mm), x/mm, "x, mm" and x in mm have one. `x_mm [mm]`, as a line of
    units below the names gives it, has two.
    """
    plain, units = _without_unit(name, role)
    if units and name.endswith(("]", ")")):
        plain, inner = _without_unit(plain, role)
        units += inner
    return plain, units


def without_each_unit(name: str, role: str) -> list[str]:
    """Return a name without the unit at its end, and without the two."""
    return [_without_unit(name, role)[0], without_units(name, role)[0]]


def _without_unit(name: str, role: str) -> tuple[str, list[str]]:
    units = "|".join(re.escape(unit) for unit in sorted(UNITS[role], key=len, reverse=True))
    match = re.fullmatch(
        rf"(.+?)(?:_({units})|\s*\[({units})\]|\s*\(({units})\)|\s*[/,]\s*({units})|\s+in\s+({units}))",
        name,
    )
    if match is None:
        return name, []
    return match[1], [unit for unit in match.groups()[1:] if unit is not None]


def foreign_unit(name: str, role: str) -> str | None:
    """Return the unknown unit for which alone a column lacks its role, None if that is not so.

    It stands in brackets, or is short: `force_sensor` has none.
    """
    found = re.fullmatch(r"(.+?)(?:_([^\W\d_]{1,3})|\s*[\[(]([^\])]{1,9})[\])])", name)
    if found is None or found[1].lower() not in _NAMES[role] | _SENSORS[role]:
        return None
    unit = found[2] or found[3]
    return None if unit.lower() in _AXES else unit


def may_be(name: str, role: str) -> bool:
    """Return whether a word in a column's name, or its unit, is one of a role's."""
    plain, units = without_units(name, role)
    words = {word for word in re.split(r"[^a-z]+", plain.lower()) if len(word) > 1}
    known = _NAMES[role] | _SENSORS[role]
    return bool(units) or bool(words & known)


def turned(columns: tuple[str, str], *roles: str) -> str:
    """Return the option to paste that turns the sign of `roles`, of the columns of both."""
    names = dict(zip(("position", "force"), columns, strict=True))
    words = []
    for role in roles:
        sign, name = ("", names[role][1:]) if names[role].startswith("-") else ("-", names[role])
        words.append(shlex.quote(f"{role}={sign}{name}"))
    return f"--columns {' '.join(words)}"


def exchanged(columns: tuple[str, str]) -> str:
    """Return the option to paste that takes the column of each role for the other."""
    position, force = (shlex.quote(name) for name in columns)
    return f"--columns position={force} force={position}"
