"""Units that a column of a recording may have, by the role of the column."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from teleop_rt.config.section import LEAST, MOST

_DEGREE = np.pi / 180.0
_MICRO = ("u", "\u00b5", "\u03bc")  # u, the micro sign, the Greek letter


def _prefixed(unit: str, *prefixes: str) -> dict[str, float]:
    """Return the unit and its multiples by SI prefix."""
    powers = {"k": 1e3, "": 1.0, "c": 1e-2, "m": 1e-3, "n": 1e-9, "p": 1e-12}
    powers |= dict.fromkeys(_MICRO, 1e-6)
    return {f"{prefix}{unit}": powers[prefix] for prefix in ("", *prefixes)}


_INCH, _GRAVITY, _POUND = 0.0254, 9.80665, 0.45359237  # m, m/s2, kg: exact by definition
_LENGTHS = {**_prefixed("m", "c", "m", *_MICRO, "n"), "in": _INCH, "inch": _INCH}
ANGLES = {**_prefixed("rad", "m", *_MICRO), "deg": _DEGREE, "\u00b0": _DEGREE, "rev": 2.0 * np.pi}
_WEIGHTS = {"kgf": _GRAVITY, "gf": 1e-3 * _GRAVITY, "kg": _GRAVITY, "g": 1e-3 * _GRAVITY,
            "lbf": _POUND * _GRAVITY, "lb": _POUND * _GRAVITY}  # fmt: skip
_IN_SMALL_LETTERS = {"n": 1.0, "kn": 1e3}  # of names such as force_n; mn and nm are several units
_FORCES = _prefixed("N", "k", "m", *_MICRO, "n", "p") | _WEIGHTS | _IN_SMALL_LETTERS
_TORQUES = {**_prefixed("Nm", "k", "m", *_MICRO, "n"), "Ncm": 1e-2, "Nmm": 1e-3}
_TORQUES |= {unit.replace("N", f"N{mark}"): factor for unit, factor in _TORQUES.items()
             for mark in (" ", "*", "\u00b7", ".")}  # fmt: skip
_POSITIONS = _LENGTHS | ANGLES
_SPEEDS = {f"{u}{per}s": f for u, f in _POSITIONS.items() for per in ("/", "_per_", "_")}
_TIMES = {**_prefixed("s", "m", *_MICRO, "n"), **dict.fromkeys(("sec", "sec.", "seconds"), 1.0),
          "min": 60.0, "h": 3600.0}  # fmt: skip
UNITS: dict[str, dict[str, float]] = {
    "time": _TIMES,
    "position": _POSITIONS,
    "force": _FORCES | _TORQUES,
    "velocity": _SPEEDS,
    "reference": _POSITIONS,
    "surface": _POSITIONS,
}

FOREIGN = {"\u00b0C", "K", "V", "A", "mA", "mV", "Hz", "rpm", "bar", "MPa", "kPa"}
_OTHERS = {"-", "1", "%"} | FOREIGN
"""Units of columns that a recording may have beside them; FOREIGN ones are of no role."""


def are_units(cells: Sequence[str]) -> bool:
    """Return whether a line's cells are units: half of them at least, one of a column that counts.

    Cells without a text are those of columns without a unit.
    """
    given = [cell.strip("[]()") for cell in cells if cell]
    known = [cell for cell in given if any(cell in units for units in UNITS.values())]
    others = [cell for cell in given if cell in _OTHERS]
    return bool(known) and 2 * (len(known) + len(others)) >= len(given)


def factor_of(role: str, unit: str | float) -> float:
    """Return the factor from a unit of a role to the recording's own; a number is a factor itself.

    Raises ValueError naming the units that there are, or for a factor that makes no sense.
    """
    if unit in UNITS[role]:
        return UNITS[role][str(unit)]
    try:
        factor = float(unit)
    except ValueError:
        known = ", ".join(UNITS[role])
        raise ValueError(f"unknown unit {unit!r} of {role}; one of {known}, or a factor") from None
    if not LEAST <= abs(factor) <= MOST:
        raise ValueError(f"the factor {factor:g} of {role} is not between {LEAST:g} and {MOST:g}")
    return factor
