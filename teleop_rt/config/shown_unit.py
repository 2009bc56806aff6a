"""Words on a parameter for people: the names of units, and the doubt of a value."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_NAMES = {"N s^2/m": "kg", "Nm s^2/rad": "kg m^2"}
"""A mass is shown in kg, whatever units a model multiplies."""


def shown_unit(unit: str) -> str:
    """Return the name by which people know a unit of the files."""
    return _NAMES.get(unit, unit)


def doubt_of(parameter: Mapping[str, Any]) -> str:
    """Return the doubt of an estimator's parameter as a summary has it, empty where there is none.

    Its deviation says how near to 0 a value is that the data do not determine.
    """
    if parameter.get("identified") is not False:
        return ""
    std = parameter["std"]
    if std is not None and std > abs(parameter["value"]):
        return "not determined: its deviation exceeds it"
    return "not identified"
