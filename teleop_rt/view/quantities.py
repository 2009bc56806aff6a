"""Display units: small lengths and angles, and the units of parameters."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from teleop_rt.config.parameter_words import at_depth_in_words, shown_unit
from teleop_rt.config.section import Units
from teleop_rt.contact.effects import LIBRARY
from teleop_rt.contact.models import MODELS
from teleop_rt.metrics import in_percent
from teleop_rt.view.style import printed, with_unit

_TENTH = 0.1  # from this share on, two digits are as short as one
SMALL = 1e3
"""Positions are shown in thousandths of the rig's unit."""


def small(position_unit: str) -> str:
    """Return the unit in which positions are shown: `mm` for m, `mrad` for rad."""
    return f"m{position_unit}"


def small_position(value: float | None, position_unit: str) -> str:
    """Return a position of the rig's unit as it is shown; a dash where there is none."""
    return with_unit(None if value is None else SMALL * value, small(position_unit), 5)


def stiffness_units(units: Units) -> dict[str, str]:
    """Return the units of a rendered stiffness and damping, by these names."""
    stiffness, damping = f"{units.force}/{units.position}", f"{units.force} s/{units.position}"
    return {"stiffness": stiffness, "damping": damping}


def size_seen(effect: Mapping[str, Any], base: Mapping[str, Any]) -> str:
    """Return the size of an effect that would have been detected, with its share of the base.

    `base` has the parameters of the base by their names: one with the unit of the size gives the
    share. Exponents of a unit that are shapes of the effect are given as numbers; a size with a
    value at a depth is given by that alone.
    """
    if reached := at_depth_in_words(effect):
        return reached
    unit = "(ratio)" if effect["unit"] == "1" else shown_unit(effect["unit"])
    for name, value in effect["shape"].items():
        unit = unit.replace(f"({name}+1)", f"{value + 1.0:.3g}").replace(name, f"{value:.3g}")
    share = ""
    for name, parameter in base.items():
        if parameter["unit"] == effect["unit"] and parameter["value"]:
            ratio = effect["size"] / abs(parameter["value"])
            share = f" ({in_percent(ratio, 2 if ratio >= _TENTH else 1)} of {name})"
    return f"{effect['size']:.3g} {unit}{share}"


def parameter_unit(model: str, name: str, position_unit: str, force_unit: str) -> str:
    """Return the unit of a model's parameter, or of an effect beside it, as print has it.

    `-` for a pure number, `SI` for an effect that is not of the library, or of which one law has
    another unit than the next.
    """
    units = {effect.amplitude.unit for effect in LIBRARY if effect.name == name}
    units = {one.unit for one in MODELS[model].parameters if one.name == name} or units
    unit = (
        (units.pop() if len(units) == 1 else "SI")
        .replace("{x}", position_unit)
        .replace("{f}", force_unit)
    )
    return "-" if unit == "1" else printed(shown_unit(unit))
