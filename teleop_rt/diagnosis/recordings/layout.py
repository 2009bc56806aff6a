"""Roles and units of a file's columns: given, or derived from the columns' names."""

from __future__ import annotations

import difflib
import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.diagnosis.recordings.columns_file import ColumnsFile, load_columns
from teleop_rt.diagnosis.recordings.units import ANGLES, UNITS, factor_of
from teleop_rt.errors import RecordingError

_NAMES = {
    "time": {"t", "time", "timestamp"},
    "position": {"position", "pos", "x", "angle", "displacement"},
    "force": {"force", "f", "F", "torque"},
    "surface": {"surface"},
}
_SENSORS = {
    "time": {"elapsed", "elapsed_time", "datetime", "date/time", "zeit", "pr\u00fcfzeit"},
    "position": {"encoder", "stroke", "travel", "depth", "indentation", "disp", "extension", "weg",
                 "standardweg"},
    "force": {"load", "load_cell", "loadcell", "fz", "kraft", "standardkraft"},
}  # fmt: skip
"""Names that are taken for a role where no column has a name of the quantity itself."""


@dataclass(frozen=True)
class Layout:
    """Which column (or matrix element "name[2]") plays which role, with unit and sign.

    `valid` is a column that is 0 where a sample is missing, `force_lag_s` how late the force comes,
    `surface` where the surface is, in the unit of the position, if that is known.
    """

    columns: Mapping[str, str]
    units: Mapping[str, str | float]
    rate_hz: float | None = None
    valid: str | None = None
    force_lag_s: float = 0.0
    surface: float | None = None


@dataclass(frozen=True)
class Column:
    """Values in s, m, rad, N, Nm or their rates, `factor` times those of the file.

    `rotary` where they are angles; a negative factor where the sign was turned; `stated` where the
    file or the user says the unit.
    """

    values: Vector
    rotary: bool = False
    factor: float = 1.0
    stated: bool = False


def layout_of(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Layout:
    """Return the given layout, completed from NAME.columns.yaml beside the file if there is one.

    The YAML file has `columns` and `units` by role, `rate_hz`, `valid`, `surface` and
    `force_lag_ms`, which are those of its own position and force. A minus before a column's name
    turns its sign.
    """
    beside = path.with_name(path.stem + ".columns.yaml")
    stated = load_columns(beside) if beside.exists() else ColumnsFile()
    all_columns = stated.columns.given() | dict(columns or {})
    all_units = stated.units.given() | dict(units or {})
    if unknown := (set(all_columns) | set(all_units)) - set(UNITS):
        raise RecordingError(
            f"{path}: unknown role {', '.join(sorted(unknown))}; roles: {', '.join(UNITS)}"
        )
    lag_ms = 0.0 if "force" in (columns or {}) else stated.force_lag_ms
    surface = None if "position" in (columns or {}) else stated.surface
    return Layout(
        all_columns, all_units, rate_hz or stated.rate_hz, stated.valid, lag_ms * 1e-3, surface
    )


def columns_of(path: Path, table: Mapping[str, Vector], layout: Layout) -> dict[str, Column]:
    """Return the columns by role, which are given or follow from their names.

    Raises RecordingError if a given column or unit is unknown, if two names fit one role, and if
    there is no position or no force.
    """
    found = {}
    for role in UNITS:
        name = layout.columns.get(role) or _column_named(path, table, role)
        if name is not None:
            found[role] = _column(path, table, role, name, layout.units.get(role))
    if lacking := [role for role in ("position", "force") if role not in found]:
        _refuse_foreign_unit(path, table, lacking)
        if "time" not in found and layout.rate_hz is None:
            lacking.insert(0, "time")
        raise RecordingError(
            f"{path}: no column for {_listed(lacking)}; there are: {', '.join(table)}; name it"
            f" with {_flags(table, lacking)} or in {path.stem}.columns.yaml"
        )
    return found


def _listed(roles: Sequence[str]) -> str:
    """Return the roles as a sentence lists them."""
    *first, last = roles
    return f"{', '.join(first)} and {last}" if first else last


def _flags(table: Mapping[str, Vector], lacking: Sequence[str]) -> str:
    """Return the flags that name the columns of these roles, with those that may be meant.

    A motor's current is none, but gives a force with the motor's constant.
    """
    meant = {role: [name for name in table if _may_be(name, role)] for role in lacking}
    given = [f"{role}={names[0] if len(names) == 1 else 'NAME'}" for role, names in meant.items()]
    flags = f"--columns {' '.join(shlex.quote(text) for text in given)}"
    current = next((n for n in table if re.search(r"current|(_|\[|\(|/)m?A[\])]?$", n)), None)
    if "force" in lacking and not meant["force"] and current is not None:
        force = shlex.quote(f"force={current}")
        flags += f" (for a motor's current: {force} --units force=NEWTON_PER_UNIT)"
    return flags


def _may_be(name: str, role: str) -> bool:
    """Return whether a word in a column's name, or its unit, is one of a role's."""
    plain, unit = _without_unit(name, role)
    words = {word for word in re.split(r"[^a-z]+", plain.lower()) if len(word) > 1}
    known = _NAMES[role] | _SENSORS[role]
    return unit is not None or bool(words & known)


def _refuse_foreign_unit(path: Path, table: Mapping[str, Vector], roles: list[str]) -> None:
    """Raise RecordingError where a column lacks its role only because its unit is unknown."""
    found = [
        (role, name, found_unit[2])
        for role in roles
        for name in table
        if (found_unit := re.fullmatch(r"(.+?)(?:_|\s*[\[(])([^\W_]{1,4})[\])]?", name))
        and found_unit[1].lower() in _NAMES[role]
    ]
    if found:
        cause = ", ".join(f"{name} (unit {unit!r})" for _, name, unit in found)
        columns = " ".join(f"--columns {role}={name}" for role, name, _ in found)
        units = " ".join(f"--units {role}=FACTOR" for role, _, _ in found)
        raise RecordingError(
            f"{path}: unknown unit of {cause}; give its factor to m, rad, N or Nm:"
            f" {columns} {units}"
        )


def _column_named(path: Path, table: Mapping[str, Vector], role: str) -> str | None:
    """Return the one column whose name fits the role, None if there is none."""
    plain = {name: _without_unit(name, role)[0] for name in table if table[name].size > 1}
    # A capital letter alone is another quantity (T a period), a capital in a word is not.
    plain = {
        name: word if len(word) == 1 else word.lower().replace(" ", "_")
        for name, word in plain.items()
    }
    known = [name for name, word in plain.items() if word in _NAMES.get(role, ())]
    known = known or [name for name, word in plain.items() if word in _SENSORS.get(role, ())]
    # A letter alone may be anything beside a word; one with a unit is as good as a word.
    long = [name for name in known if len(plain[name]) > 1 or name != plain[name]]
    if len(long or known) > 1:
        raise RecordingError(
            f"{path}: {', '.join(long or known)} could each be the {role}; say which with"
            f" --columns {role}=NAME or in {path.stem}.columns.yaml"
        )
    return next(iter(long or known), None)


def _without_unit(name: str, role: str) -> tuple[str, str | None]:
    """Return a name and the unit that it ends with: x_mm, x [mm], x (mm), x/mm, x in mm."""
    units = "|".join(re.escape(unit) for unit in sorted(UNITS[role], key=len, reverse=True))
    match = re.fullmatch(
        rf"(.+?)(?:_({units})|\s*\[({units})\]|\s*\(({units})\)|\s*/\s*({units})|\s+in\s+({units}))",
        name,
    )
    if match is None:
        return name, None
    return match[1], next(unit for unit in match.groups()[1:] if unit is not None)


def _in_full(path: Path, table: Mapping[str, Vector], role: str, name: str) -> str:
    """Return the column of this name, or the one that has it before its unit."""
    if name in table:
        return name
    alike = [column for column in table if _without_unit(column, role)[0] == name]
    if len(alike) == 1:
        return alike[0]
    known = {_without_unit(column, role)[0]: column for column in table}
    known |= {column: column for column in table}
    near = [] if alike else difflib.get_close_matches(name, known, n=1)
    meant = f" did you mean {known[near[0]]!r}?" if near else ""
    raise RecordingError(
        f"{path}: no column {name!r} for {role};{meant} there are: {', '.join(table)}"
    )


def _column(
    path: Path, table: Mapping[str, Vector], role: str, name: str, unit: str | float | None
) -> Column:
    sign, plain = (-1.0, name[1:]) if name.startswith("-") else (1.0, name)
    plain = _in_full(path, table, role, plain)
    unit = unit or _without_unit(plain, role)[1]
    try:
        factor = 1.0 if unit is None else factor_of(role, unit)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    values = np.asarray(sign * factor * table[plain], dtype=np.float64)
    return Column(values, unit in ANGLES, sign * factor, unit is not None)
