"""One language of colours, line styles, names and numbers for everything that people look at."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from importlib.resources import files
from types import MappingProxyType
from typing import Any, Literal

from teleop_rt.config.parameter_words import (
    NO_DEVIATION,
    at_depth_in_words,
    beside,
    doubt_of,
    known,
    shown_unit,
    spread_in_words,
)
from teleop_rt.estimation.rows import FROZEN_LABEL
from teleop_rt.trial.grades import MARKS

__all__ = ["MARKS", "NO_DEVIATION", "shown_unit"]
Style = Literal["solid", "dashed", "dotted", "dotdash"]

# Okabe and Ito 2008, and a line style each: curves must be distinguishable in grey, too.
BLUE, VERMILLION, GREEN = "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, BLACK = "#CC79A7", "#E69F00", "#56B4E9", "#000000"
FAINT = 0.35
"""Opacity of a curve that stands behind another."""
COLOURS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK)
STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 1)), "-")
DASHES: tuple[Style, ...] = ("solid", "dashed", "dotdash", "dotted")
MARKERS = "osD^vPX"
TRUTH_STYLE = MappingProxyType({"color": "black", "linewidth": 0.8, "linestyle": ":"})


@dataclass(frozen=True, slots=True)
class Palette:
    """The colour of each quantity on one ground."""

    ground: str
    panel: str
    text: str
    faint: str
    measured: str
    predicted: str
    rendered: str
    target: str
    residual: str
    shade: str
    good: str
    attention: str
    bad: str


LIGHT = Palette(
    ground="#ffffff",
    panel="#f5f6f7",
    text="#1d2329",
    faint="#5c6670",
    measured=BLUE,
    predicted=VERMILLION,
    rendered=GREEN,
    target=ORANGE,
    residual="#A64D86",
    shade="#e9ebee",
    good="#00765A",
    attention="#8F6200",
    bad="#B84300",
)
DARK = Palette(
    ground="#14181c",
    panel="#1e242a",
    text="#e8ebee",
    faint="#a3adb7",
    measured=SKY,
    predicted="#FF8A3D",
    rendered="#2BC79B",
    target=ORANGE,
    residual="#E39BC6",
    shade="#29313a",
    good="#2BC79B",
    attention=ORANGE,
    bad="#FF8A3D",
)
_RAISED = str.maketrans("0123456789+npower", "⁰¹²³⁴⁵⁶⁷⁸⁹⁺ⁿᵖᵒʷᵉʳ")
_EXPONENT = re.compile(r"\^(?:\((\w+\+1)\)|(n|\d+)(?![\d.]))")
"""A name and one in brackets, a name, or a whole number; no point can be raised."""
MEASURED, PREDICTED, RENDERED = "measured (slave)", "predicted (model)", "rendered (master)"
RAW, FILTERED = "measured, raw", "measured, filtered as the estimators see it"
TRUE_FORCE, FELT = "true environment", "felt (rendered by the master)"
REFLECTED = "the slave's force, reflected over the link"
ASKED, SURFACE, RESIDUAL = "asked for (master)", "surface", "residual: measured - predicted"
"""Names of these curves on every page."""
IN_THE_DARK = MappingProxyType(
    {getattr(LIGHT, role.name): getattr(DARK, role.name) for role in fields(Palette)}
    | {PURPLE: "#E39BC6", SKY: "#9DD9F3", BLACK: "#FFFFFF"}
)
"""The colour on the dark ground of each colour that a figure has on the light one."""
ABBREVIATED = {"kelvin-voigt": "Kelvin-Voigt", "hunt-crossley": "Hunt-Crossley"}
PARAMETER_LABELS = {
    "kelvin-voigt": {"k": "k [N/m]", "b": "b [N s/m]"},
    "hunt-crossley": {"k": "k [N/mⁿ]", "b": "b [N s/mⁿ⁺¹]", "n": "n [-]"},
}
MODEL_NAMES = MappingProxyType(
    {
        "mass": "mass",
        "kelvin-voigt": "Kelvin-Voigt",
        "kelvin-voigt-unilateral": "Kelvin-Voigt, unilateral",
        "mass-spring-damper": "mass-spring-damper",
        "hunt-crossley": "Hunt-Crossley",
        "mass-damper": "mass-damper",
    }
)


def css() -> str:
    """Return the style sheet of every page, dark where the reader prefers dark."""
    sheet = (files("teleop_rt.view") / "pages" / "style.css").read_text(encoding="utf-8")
    light, dark = (
        "".join(f"{_variable(one)}: {other}; " for one, other in colours)
        for colours in (((one, one) for one in IN_THE_DARK), IN_THE_DARK.items())
    )
    return (
        f":root {{ {light}}}\n"
        f"@media screen and (prefers-color-scheme: dark) {{ :root {{ {dark}}} }}\n{sheet}"
    )


def css_colour(colour: str) -> str:
    """Return a colour of the light ground as a style sheet writes it, which knows the dark one."""
    return f"var({_variable(colour)})"


def _variable(colour: str) -> str:
    return f"--c{colour[1:].lower()}"


def model_name(model: str) -> str:
    """Return the name of a model for people."""
    return MODEL_NAMES.get(model, model)


_SOLVERS = MappingProxyType(
    {
        "rls": "RLS",
        "sprls": "SPRLS",
        "ni-sprls": "NI-SPRLS",
        "gn-vff-rls": "GN-VFF-RLS",
        "iec": "integral error",
    }
)


def method_name(regression: str, solver: str) -> str:
    """Return a figure's name of a method; a solver may say that its effects are frozen."""
    plain = solver.removesuffix(FROZEN_LABEL)
    name = _SOLVERS.get(plain, plain)
    name += ", effects frozen" if plain != solver else ""
    return f"algebraic + {name}" if regression == "algebraic" else name


def number(value: Any, digits: int = 4) -> str:
    """Return a number as a page shows it; a dash where there is none."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    return f"{value:.{digits}g}" if isinstance(value, float) else str(value)


def with_unit(value: float | None, unit: str, digits: int = 4) -> str:
    """Return a number with its unit; a dash where there is none."""
    if not known(value):
        return "–"
    return number(value, digits) if unit == "1" else f"{number(value, digits)} {unit}"


def count_in_words(count: int, one: str, many: str | None = None) -> str:
    """Return a count with its word: `1 model`, `2 models`."""
    return f"{count} {one if count == 1 else many or f'{one}s'}"


# [m] and [N]. A figure keeps a unit down to a thousandth of it: below, the next is easier to read.
_LENGTHS = ((1e-3, "mm"), (1e-6, "µm"), (1e-9, "nm"))
_FORCES = ((1.0, "N"), (1e-3, "mN"), (1e-6, "µN"), (1e-9, "nN"))
_LEAST_OF_UNIT = 1e-3  # of a unit, see above
_NO_EXPONENT = 1e5  # below it five digits print without an exponent
_FORCE = re.compile(r"N(?=$|[ /])")  # not the Nm of a rotary rig
_POWER_OF_LENGTH = re.compile(r"(?<=/)m\^(\d+(?:\.\d+)?)$")


def in_shown_unit(content: Any) -> Any:
    """Return `{value, std, unit}` in the unit of its size: a length in mm, of a micro body in µm.

    The larger of value and std chooses the unit, so that a value near 0 does not.
    """
    size = max((abs(content[key]) for key in ("value", "std") if content[key]), default=0.0)
    factor, unit = _unit_of_size(size, shown_unit(content["unit"]))
    scaled = {key: content[key] and factor * content[key] for key in ("value", "std")}
    return {**content, **scaled, "unit": unit} if unit != content["unit"] else content


def _unit_of_size(size: float, unit: str) -> tuple[float, str]:
    """Return the factor from a unit to the one that shows a figure of this size, and that unit."""
    if unit == "m":
        step, unit = _step(size, _LENGTHS)
        return 1.0 / step, unit
    factor = 1.0
    power = _POWER_OF_LENGTH.search(unit)
    if power and size >= _NO_EXPONENT**2:  # N/m^3 of a body of some mm stays as it is
        shrunk = ((step ** float(power[1]), name) for step, name in _LENGTHS)
        factor, name = next((s, n) for s, n in (*shrunk, (0.0, "")) if s * size < _NO_EXPONENT)
        if not factor:
            return 1.0, unit
        unit = f"{unit[: power.start()]}{name}^{power[1]}"
    if _FORCE.match(unit):
        step, name = _step(size * factor, _FORCES)
        return factor / step, name + unit[1:]
    return factor, unit


def _step(size: float, steps: Sequence[tuple[float, str]]) -> tuple[float, str]:
    """Return the first step that a size is not far below, else the last; the first for 0 or NaN."""
    fits = (step for step in steps if size >= _LEAST_OF_UNIT * step[0])
    return next(fits, steps[-1] if size > 0.0 else steps[0])


def printed(unit: str) -> str:
    """Return a unit as print has it: `N s^(n+1)` with the exponent raised."""
    return _EXPONENT.sub(lambda found: (found[1] or found[2]).translate(_RAISED), unit)


def parameter(name: str, content: Any, regression: str = "direct") -> str:
    """Return `k = 3600.3 ± 0.45 N/m` of a parameter as in summary.json.

    An algebraic regression gives no deviation: a dash stands in its place.
    """
    if not known(content["value"]):
        return f"{name} –"
    if _undetermined(name, content["value"], content["std"]):
        return f"{name}: not determined"
    reached, content = printed(at_depth_in_words(content)), in_shown_unit(content)
    std = content["std"]
    spread = spread_in_words(std, regression)
    unit = "" if content["unit"] in {"1", "-"} else f" {printed(content['unit'])}"
    note = beside(reached) + beside(doubt_of(content) or content.get("note", ""))
    return f"{name} = {_as_sure(content['value'], std):.5g}{spread}{unit}{note}"


def _undetermined(name: str, value: float, std: float | None) -> bool:
    """Return whether a size of an effect is as unsure as all the sizes in which it is sought.

    A bound is no more than the value times the range's ratio. A place, or another parameter that
    may be 0, is not meant: near 0 its deviation says how near.
    """
    if std is None or std <= abs(value):
        return False
    from teleop_rt.contact.effects import LIBRARY  # noqa: PLC0415 - loads compilers

    of_name = [s for e in LIBRARY for s in e.shapes if s.name == name.replace(" ", "_")]
    sizes = [shape for shape in of_name if shape.logarithmic and shape.lower > 0.0]
    return bool(sizes) and all(std > abs(value) * s.upper / s.lower for s in sizes)


def _as_sure(value: float, std: float | None) -> float:
    """Return a value without the digits below the two that its standard deviation is shown with."""
    if not std or not math.isfinite(std):
        return value
    return round(value, 1 - math.floor(math.log10(abs(std))))


def effect_in_words(effect: Mapping[str, Any]) -> str:
    """Return the sentence of an effect that was found, with its figures."""
    shown = {key: in_shown_unit(p) for key, p in effect["parameters"].items()}
    figures = {
        f"{sign}{key}": "–"
        if not known(p["value"])
        else f"{factor * p['value']:.4g} {printed(p['unit'])}".removesuffix(" 1")
        for key, p in shown.items()
        for sign, factor in (("", 1.0), ("-", -1.0))
    }
    return str(effect["template"]).format(**figures)
