"""Units that a column of a recording may have, by the role of the column."""

from __future__ import annotations

import numpy as np

from teleop_rt.section import LEAST, MOST

_DEGREE = np.pi / 180.0
_MICRO = ("u", "\u00b5", "\u03bc")  # u, the micro sign, the Greek letter


def _prefixed(unit: str, *prefixes: str) -> dict[str, float]:
    """Return the unit and its multiples by SI prefix."""
    powers = {"k": 1e3, "": 1.0, "c": 1e-2, "m": 1e-3, "n": 1e-9, "p": 1e-12}
    powers |= dict.fromkeys(_MICRO, 1e-6)
    return {f"{prefix}{unit}": powers[prefix] for prefix in ("", *prefixes)}


_LENGTHS = _prefixed("m", "c", "m", *_MICRO, "n")
ANGLES = {**_prefixed("rad", "m", *_MICRO), "deg": _DEGREE, "rev": 2.0 * np.pi}
_FORCES = _prefixed("N", "k", "m", *_MICRO, "n", "p")
_TORQUES = {**_prefixed("Nm", "k", "m", *_MICRO, "n"), "Ncm": 1e-2, "Nmm": 1e-3}
_POSITIONS = _LENGTHS | ANGLES
_SPEEDS = {f"{u}{per}s": f for u, f in _POSITIONS.items() for per in ("/", "_per_", "_")}
UNITS: dict[str, dict[str, float]] = {
    "time": {**_prefixed("s", "m", *_MICRO, "n"), "min": 60.0},
    "position": _POSITIONS,
    "force": _FORCES | _TORQUES,
    "velocity": _SPEEDS,
    "reference": _POSITIONS,
    "surface": _POSITIONS,
}


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
