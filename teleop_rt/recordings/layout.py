"""Roles and units of a file's columns: given, or derived from the columns' names."""

from __future__ import annotations

import difflib
import re
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.column_names import (
    NEEDED,
    columns_named,
    foreign_unit,
    is_plain,
    may_be,
    without_each_unit,
    without_units,
)
from teleop_rt.recordings.columns_file import ColumnsFile, load_columns
from teleop_rt.recordings.units import ANGLES, FOREIGN, UNITS, factor_of

_ASSUMED = {"time": "s", "force": "N", "velocity": "m/s"}
"""Units of a role's column where none is given; m for all others."""


@dataclass(frozen=True)
class Layout:
    """Which column (or matrix element "name[2]") plays which role, with unit and sign.

    `valid` is a column that is 0 where a sample is missing, `force_lag_s` how late the force comes,
    known to `force_lag_deviation_s`, `surface` where the surface is, in the unit of the position,
    if that is known, and `surface_deviation` how well.
    """

    columns: Mapping[str, str]
    units: Mapping[str, str | float]
    rate_hz: float | None = None
    valid: str | None = None
    force_lag_s: float = 0.0
    surface: float | None = None
    force_lag_deviation_s: float = 0.0
    surface_deviation: float = 0.0


@dataclass(frozen=True)
class Column:
    """Values in s, m, rad, N, Nm or their rates, `factor` times those of the file.

    `rotary` where they are angles; a negative factor where the sign was turned; `stated` where the
    file or the user says the unit; `name` has a minus where the sign was turned.
    """

    values: Vector
    rotary: bool = False
    factor: float = 1.0
    stated: bool = False
    name: str = "NAME"


def layout_of(
    path: Path,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    rate_hz: float | None = None,
) -> Layout:
    """Return the given layout, completed from NAME.columns.yaml beside the file if there is one.

    The YAML file has `columns` and `units` by role, `rate_hz`, `valid`, `surface`, `force_lag_ms`
    and its deviation, which are those of its own position and force. A minus before a column's name
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
    lags_ms = (stated.force_lag_ms, stated.force_lag_deviation_ms)
    lag_ms, deviation_ms = (0.0, 0.0) if "force" in (columns or {}) else lags_ms
    surface, spread = stated.surface, stated.surface_deviation
    if "position" in (columns or {}):
        surface, spread = None, 0.0
    return Layout(
        all_columns,
        all_units,
        rate_hz or stated.rate_hz,
        stated.valid,
        lag_ms * 1e-3,
        surface,
        deviation_ms * 1e-3,
        spread,
    )


def columns_of(path: Path, table: Mapping[str, Vector], layout: Layout) -> dict[str, Column]:
    """Return the columns by role, which are given or follow from their names.

    No column of times is sought beside a rate where position and force are given.

    Raises RecordingError if a given column or unit is unknown, if two names fit one role, if the
    name of a column states two units, and if there is no time (nor a rate), position or force.
    """
    named = {role: _named(table, layout, role) for role in UNITS}
    if layout.rate_hz is not None and {"position", "force"} <= layout.columns.keys():
        named["time"] = [layout.columns["time"]] if "time" in layout.columns else []
    _refuse_unclear(path, table, layout, named)
    columns = {
        role: _in_full(path, table, role, names[0]) for role, names in named.items() if names
    }
    _compare_units(path, columns, layout.units)
    found = {
        role: _column(path, table, role, name, layout.units.get(role))
        for role, name in columns.items()
    }
    by_sensor = any(
        role not in layout.columns and not is_plain(column, role)
        for role, column in columns.items()
    )
    if by_sensor or not all(column.stated for column in found.values()):
        _print_read(path, columns, layout.units)
    return found


def _named(table: Mapping[str, Vector], layout: Layout, role: str) -> list[str]:
    """Return the given column, or those whose names fit: in any unit, where theirs is stated."""
    if role in layout.columns:
        return [layout.columns[role]]
    found = columns_named(table, role)
    if not found and role in NEEDED and role in layout.units:
        found = [name for name in table if foreign_unit(name, role) is not None]
    return found


def _print_read(path: Path, columns: Mapping[str, str], stated: Mapping[str, str | float]) -> None:
    """Print which column is read for which role, and in which unit, where one is a guess."""
    read = []
    for role, name in columns.items():
        units = [stated[role]] if role in stated else without_units(name, role)[1]
        unit = units[0] if units else f"{_ASSUMED.get(role, 'm')}, as none is given"
        read.append(f"{role} = {name.removesuffix(f' [{unit}]')} [{unit}]")
    print(f"{path}: read: {', '.join(read)}", file=sys.stderr)


def _refuse_unclear(
    path: Path, table: Mapping[str, Vector], layout: Layout, named: Mapping[str, Sequence[str]]
) -> None:
    """Raise RecordingError with all roles that lack a column, or that several columns could have.

    The message lists the columns found, and the options to complete and to paste.
    """
    needed = [role for role in NEEDED if role != "time" or layout.rate_hz is None]
    lacking = [role for role in needed if not named[role]]
    several = {role: names for role, names in named.items() if len(names) > 1}
    if not lacking and not several:
        return
    foreign = {
        role: (name, unit)
        for role in lacking
        for name in table
        if (unit := foreign_unit(name, role)) is not None
    }
    nothing = [role for role in lacking if role not in foreign]
    causes = [f"no column for {_listed(nothing)}"] if nothing else []
    causes += [f"{', '.join(names)} could each be the {role}" for role, names in several.items()]
    if foreign:
        units = ", ".join(f"{name} (unit {unit!r})" for name, unit in foreign.values())
        causes.append(f"unknown unit of {units}: give its factor to s, m, rad, N or Nm")
    rate = ", or give the samples per second with --rate" if "time" in lacking else ""
    raise RecordingError(
        f"{path}: {'; '.join(causes)}; there are: {', '.join(table)}; write"
        f" {_options(table, [*lacking, *several], foreign)}, or name them in"
        f" {path.stem}.columns.yaml{rate}"
    )


def _listed(roles: Sequence[str]) -> str:
    """Return the roles as a sentence lists them."""
    *first, last = roles
    return f"{', '.join(first)} and {last}" if first else last


def _options(
    table: Mapping[str, Vector], roles: Sequence[str], foreign: Mapping[str, tuple[str, str]]
) -> str:
    """Return the options that name the columns of these roles, with those that may be meant.

    A motor's current is not a force, but gives one with the motor's constant.
    """
    meant = {role: [name for name in table if may_be(name, role)] for role in roles}
    meant |= {role: [name] for role, (name, _) in foreign.items()}
    given = [f"{role}={names[0] if len(names) == 1 else 'NAME'}" for role, names in meant.items()]
    options = f"--columns {' '.join(shlex.quote(text) for text in given)}"
    if foreign:
        options += f" --units {' '.join(f'{role}=FACTOR' for role in foreign)}"
    current = next((n for n in table if re.search(r"current|(_|\[|\(|/)m?A[\])]?$", n)), None)
    if "force" in roles and not meant["force"] and current is not None:
        force = shlex.quote(f"force={current}")
        options += f" (for a motor's current: {force} --units force=NEWTON_PER_UNIT)"
    return options


def _in_full(path: Path, table: Mapping[str, Vector], role: str, given: str) -> str:
    """Return the column of this name, or the one that has it before its unit, with its minus."""
    sign, name = ("-", given[1:]) if given.startswith("-") else ("", given)
    if name in table:
        return given
    alike = [column for column in table if name in without_each_unit(column, role)]
    if len(alike) == 1:
        return sign + alike[0]
    known = {without_units(column, role)[0]: column for column in table}
    known |= {column: column for column in table}
    near = [] if alike else difflib.get_close_matches(name, known, n=1)
    meant = f" did you mean {known[near[0]]!r}?" if near else ""
    raise RecordingError(
        f"{path}: no column {name!r} for {role};{meant} there are: {', '.join(table)}"
    )


def _compare_units(
    path: Path, columns: Mapping[str, str], stated: Mapping[str, str | float]
) -> None:
    """Print where the unit that is stated differs from the name's: the stated one counts.

    Raises RecordingError where a name has two units that differ, and none is stated.
    """
    two = {}
    for role, name in columns.items():
        units = without_units(name, role)[1]
        if role not in stated:
            if len({factor_of(role, unit) for unit in units}) > 1:
                two[role] = units
        elif units and stated[role] not in units:
            print(
                f"{path}: {name} is read with the unit {stated[role]}, as stated, in place of"
                f" {units[0]}, as named",
                file=sys.stderr,
            )
    if two:
        names = ", ".join(f"{columns[role]} ({' or '.join(units)}?)" for role, units in two.items())
        options = " ".join(f"{role}={units[0]}" for role, units in two.items())
        raise RecordingError(
            f"{path}: two units of {names}: state the true one, as --units {options},"
            f" or in {path.stem}.columns.yaml"
        )


def _column(
    path: Path, table: Mapping[str, Vector], role: str, name: str, unit: str | float | None
) -> Column:
    sign, plain = (-1.0, name[1:]) if name.startswith("-") else (1.0, name)
    unit = unit or next(iter(without_units(plain, role)[1]), None)
    other = re.search(r"[\[(]([^\])]+)[\])]$", plain)
    if unit is None and other is not None and other[1] in FOREIGN:
        raise RecordingError(
            f"{path}: {plain}: {other[1]} is no unit of {role}: give the factor to s, m, rad, N or"
            f" Nm, as --units {role}=FACTOR"
        )
    try:
        factor = 1.0 if unit is None else factor_of(role, unit)
    except ValueError as error:
        raise RecordingError(f"{path}: {error}") from None
    values = np.asarray(sign * factor * table[plain], dtype=np.float64)
    return Column(values, unit in ANGLES, sign * factor, unit is not None, name)
