"""Words on a parameter for people: the names of units, and the doubt of a value."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

_NAMES = {"N s^2/m": "kg", "Nm s^2/rad": "kg m^2"}
"""A mass is shown in kg, whatever units a model multiplies."""
_POWER_OF_DEPTH = re.compile(
    r"(?P<over>.+)/(?P<depth>m|rad)\^(?:(?P<power>[a-z]+)|\((?P<more>[a-z]+)\+(?P<rest>\d)\))"
)
"""Unit of a size that a power of the depth multiplies: N/m^n, or N s/m^(n+1)."""

NO_DEVIATION = "± –: no deviation; an algebraic regression sums up the noise, which colours it"
"""Why a row of an algebraic regression has no standard deviations."""


def spread_in_words(std: float | None, regression: str) -> str:
    """Return ` ± 0.45` of a deviation with two digits, empty where none is known.

    A row of an algebraic regression never has one: a dash stands in its place.
    """
    if std is None:
        return " ± –" if regression == "algebraic" else ""
    return f" ± {float(f'{std:.2g}'):g}"


def known(value: float | None) -> bool:
    """Return whether there is a value: a dash is shown for none, and for not-a-number."""
    return value is not None and not math.isnan(value)


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


def reached_by(
    unit: str, size: float, exponents: Mapping[str, float], depth: float
) -> dict[str, float | str]:
    """Return `{at_depth, value_at_depth, unit_at_depth}` of a law size * x^n; empty of any other.

    `unit` is that of the size, with the name of the exponent; `depth` [rig unit] is one that was
    reached: no reader has a feeling for N/m^5.4.
    """
    found = _POWER_OF_DEPTH.fullmatch(unit)
    if found is None or not depth > 0.0 or set(exponents) != {found["power"] or found["more"]}:
        return {}
    (exponent,) = exponents.values()
    left = found["over"]
    if rest := found["rest"]:
        left += f"/{found['depth']}" if rest == "1" else f"/{found['depth']}^{rest}"
    return {"at_depth": depth, "value_at_depth": size * depth**exponent, "unit_at_depth": left}


def at_depth_in_words(parameter: Mapping[str, Any]) -> str:
    """Return `3.1 N at 5 mm` of a size that has a value at a depth, empty for the others."""
    value = parameter.get("value_at_depth")
    found = _POWER_OF_DEPTH.fullmatch(parameter["unit"])
    if value is None or found is None:
        return ""
    depth = f"{1e3 * parameter['at_depth']:.3g} m{found['depth']}"
    return f"{value:.3g} {parameter['unit_at_depth']} at {depth}"


def beside(words: str) -> str:
    """Return words in brackets, empty without any."""
    return f" ({words})" if words else ""
