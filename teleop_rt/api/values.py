"""A parameter with its deviation and unit, and tables of them for a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

from teleop_rt.config.parameter_words import shown_unit


@dataclass(frozen=True, slots=True, repr=False)
class Parameter:
    """A parameter: value, standard deviation and unit; None where a value is not known.

    `identified` is False where the data do not determine the parameter.
    """

    value: float | None
    std: float | None
    unit: str
    identified: bool = True

    @classmethod
    def of(cls, reported: Mapping[str, Any]) -> Parameter:
        """Return a parameter as answers and summaries hold it."""
        identified = (
            reported.get("identified") is not False and reported.get("note") != "not identified"
        )
        return cls(reported["value"], reported["std"], reported["unit"], identified)

    def __repr__(self) -> str:
        spread = "" if self.std is None else f" ± {self.std:.2g}"
        unit = "" if self.unit == "1" else f" {shown_unit(self.unit)}"
        note = "" if self.identified else " (not identified)"
        return f"{number(self.value)}{spread}{unit}{note}"


def number(value: float | None) -> str:
    """Return a number with five digits, or a dash."""
    return "–" if value is None else f"{value:.5g}"


def named(parameters: Mapping[str, Parameter]) -> str:
    """Return parameters as one line."""
    return ", ".join(f"{name} = {value}" for name, value in parameters.items())


def table(caption: str, header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return an HTML table; every cell is escaped."""
    head = "".join(f"<th>{escape(cell)}</th>" for cell in header)
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows
    )
    return (
        f"<table><caption>{escape(caption)}</caption><thead><tr>{head}</tr></thead>"
        f"<tbody>{body}</tbody></table>"
    )
