"""The command that lists the effects that a diagnosis can name, with their parameters."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

from teleop_rt.config.parameter_words import shown_unit
from teleop_rt.errors import ExpectedError

if TYPE_CHECKING:
    from teleop_rt.contact.effect import Amplitude, Effect, Shape


class UnknownEffectError(ExpectedError):
    """No effect has this name."""


SCALES = {
    "travel": "the largest penetration",
    "speed": "the largest speed",
    "duration": "the length of the recording",
    "compliance": "the largest penetration over the largest force",
    "force": "the largest force",
    "place": "the largest penetration, counted from the middle of the stroke",
    "range": "half the range of the force, counted from its middle",
}
"""The scales of a recording in which bounds are given, in words."""


def effects(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[EFFECT]...", help="show laws and parameters of these effects"),
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="print one line of JSON per effect, with all parameters")
    ] = False,
) -> None:
    """List the effects that diagnose can name, and that a model can be extended by."""
    from teleop_rt.contact.effects import LIBRARY  # noqa: PLC0415 - loads compilers

    laws: dict[str, list[Effect]] = {}
    for effect in LIBRARY:
        laws.setdefault(effect.name, []).append(effect)
    if unknown := [name for name in names or () if name not in laws]:
        raise UnknownEffectError(f"no effect {unknown[0]!r}; one of: {', '.join(laws)}")
    chosen = [laws[name] for name in names or laws]
    if as_json:
        for known in chosen:
            print(json.dumps(_entry(known)))
    elif names:
        for known in chosen:
            _print_parameters(known)
    else:
        _print_overview(chosen)


def _print_overview(chosen: list[list[Effect]]) -> None:
    """Print a line for each effect."""
    from rich.table import Table  # noqa: PLC0415 - only where a table is shown

    from teleop_rt.view.console import output  # noqa: PLC0415 - as above

    table = Table("effect", "family", "part", "laws", "in words", box=None, pad_edge=False)
    for known in chosen:
        first = known[0]
        table.add_row(first.name, first.family, first.belongs_to, str(len(known)), _in_words(first))
    output().print(table, highlight=False)
    output().print("`teleop-rt effects EFFECT` lists its laws and the bounds of their parameters")


def _print_parameters(laws: list[Effect]) -> None:
    """Print the laws of an effect, with unit, bounds and neutral value of each parameter."""
    from rich.table import Table  # noqa: PLC0415 - only where a table is shown

    from teleop_rt.view.console import output  # noqa: PLC0415 - as above

    first, used = laws[0], set()
    output().print(f"{first.name} ({first.family}, {first.belongs_to}): {_in_words(first)}")
    table = Table("law", "parameter", "unit", "from", "to", "neutral", box=None, pad_edge=False)
    for law in laws:
        for row, bounds in enumerate(_parameters(law)):
            scale = bounds["relative_to"]
            used.add(scale)
            values = (_number(bounds[key], scale) for key in ("lower", "upper", "neutral"))
            shown = (law.law or "-") if row == 0 else ""
            table.add_row(shown, bounds["name"], shown_unit(bounds["unit"]), *values)
    output().print(table, highlight=False)
    for scale in sorted(used - {""}):
        output().print(f"{scale}: {SCALES[scale]}", highlight=False)
    output().print(
        "Units are those of a linear axis. Without bounds a parameter is estimated linearly; at "
        "its neutral value it has no effect.",
        highlight=False,
    )


def _number(value: float | None, scale: str) -> str:
    if value is None:
        return "-"
    return f"{value:g} {scale}" if scale and value else f"{value:g}"


def _in_words(effect: Effect) -> str:
    """Return the effect's sentence with its parameters by name, as <gap>."""
    names = (effect.amplitude.name, *(shape.name for shape in effect.shapes))
    return effect.sentence.format(**{name: f"<{name}>" for name in names})


def _parameters(law: Effect) -> list[dict[str, Any]]:
    """Return unit, bounds and neutral value of each parameter of a law, None where it has none.

    Bounds are multiples of the scale `relative_to`, and absolute where that is empty.
    """
    amplitude = law.amplitude
    bounded = amplitude.lower < amplitude.upper
    found: list[tuple[Amplitude | Shape, float | None, float | None, float | None]] = [
        (shape, shape.lower, shape.upper, shape.neutral) for shape in law.shapes
    ]
    if bounded:
        found.insert(0, (amplitude, amplitude.lower, amplitude.upper, 0.0))
    elif not amplitude.unity:
        found.insert(0, (amplitude, 0.0 if amplitude.nonnegative else None, None, 0.0))
    return [
        {
            "name": parameter.name,
            "unit": parameter.unit.format(x="m", f="N"),
            "lower": lower,
            "upper": upper,
            "relative_to": parameter.relative_to,
            "neutral": neutral,
        }
        for parameter, lower, upper, neutral in found
    ]


def _entry(laws: list[Effect]) -> dict[str, Any]:
    first = laws[0]
    return {
        "name": first.name,
        "family": first.family,
        "belongs_to": first.belongs_to,
        "laws": [law.law for law in laws],
        "parameters": {law.law: _parameters(law) for law in laws},
        "sentence": _in_words(first),
    }
