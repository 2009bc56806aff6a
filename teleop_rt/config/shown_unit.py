"""Names of units for people: a mass is shown in kg, whatever units a model multiplies."""

from __future__ import annotations

_NAMES = {"N s^2/m": "kg", "Nm s^2/rad": "kg m^2"}


def shown_unit(unit: str) -> str:
    """Return the name by which people know a unit of the files."""
    return _NAMES.get(unit, unit)
