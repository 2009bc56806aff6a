"""The command that lists the effects that a diagnosis can name."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from teleop_rt.contact.effect import Effect


def effects(
    as_json: Annotated[
        bool, typer.Option("--json", help="print one line of JSON per effect")
    ] = False,
) -> None:
    """List the effects that diagnose can name, and that a model can be extended by."""
    from teleop_rt.contact.effects import LIBRARY  # noqa: PLC0415 - loads compilers
    from teleop_rt.view.console import output  # noqa: PLC0415 - only where a table is shown

    laws: dict[str, list[Effect]] = {}
    for effect in LIBRARY:
        laws.setdefault(effect.name, []).append(effect)
    if as_json:
        for known in laws.values():
            print(json.dumps(_entry(known)))
        return
    from rich.table import Table  # noqa: PLC0415 - as above

    table = Table("effect", "family", "part", "laws", "in words", box=None, pad_edge=False)
    for known in laws.values():
        first = known[0]
        table.add_row(first.name, first.family, first.belongs_to, str(len(known)), _in_words(first))
    output().print(table, highlight=False)


def _in_words(effect: Effect) -> str:
    """Return the effect's sentence with its parameters by name, as <gap>."""
    names = (effect.amplitude.name, *(shape.name for shape in effect.shapes))
    return effect.sentence.format(**{name: f"<{name}>" for name in names})


def _entry(laws: list[Effect]) -> dict[str, Any]:
    first = laws[0]
    return {
        "name": first.name,
        "family": first.family,
        "belongs_to": first.belongs_to,
        "laws": [law.law for law in laws],
        "sentence": _in_words(first),
    }
