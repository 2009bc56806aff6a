"""The page and the tables of a study."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from html import escape
from pathlib import Path
from types import MappingProxyType
from typing import Any

from teleop_rt import __version__
from teleop_rt.view.style import css, model_name, number

_UNITS = MappingProxyType(
    {"m": "m", "mm": "mm", "s": "s", "ms": "ms", "N": "N", "J": "J", "hz": "Hz"}
)
"""Suffixes of columns that are units, as print has them."""
_LINE = 24
"""Characters of a cell that is as wide as its text; a longer one is as wide as a sentence asks."""


def table(rows: Sequence[Mapping[str, Any]], mark: str = "") -> str:
    """Return rows as an HTML table; the column `mark` gives each row its class.

    Columns are named as in the CSV file: `amplitude_m` is headed "amplitude [m]".
    """
    if not rows:
        return ""
    lines = ["<tr>" + "".join(f"<th>{escape(heading(name))}</th>" for name in rows[0]) + "</tr>"]
    for row in rows:
        kind = f' class="{escape(str(row[mark]))}"' if mark else ""
        cells = "".join(map(_cell, row.values()))
        lines.append(f"<tr{kind}>{cells}</tr>")
    inside = f"<table>{''.join(lines)}</table>"
    return f'<div class="wide" tabindex="0" role="region" aria-label="table">{inside}</div>'


def _cell(value: Any) -> str:
    text = in_words(value)
    kind = ' class="prose"' if len(text) > _LINE else ""
    return f"<td{kind}>{escape(text)}</td>"


def heading(column: str) -> str:
    """Return the heading of a column: its name in words, and the unit at its end in brackets."""
    name, _, suffix = column.rpartition("_")
    unit = _UNITS.get(suffix) if name else None
    return (f"{name} [{unit}]" if unit else column).replace("_", " ")


def in_words(value: Any) -> str:
    """Return a value as people write it: yes or no, the name of a model, a rounded number."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return model_name(value) if isinstance(value, str) else number(value)


def figure(name: str, caption: str) -> str:
    """Return a figure that lies beside the page as NAME.svg, and larger at a click."""
    return (
        f'<figure><a href="{name}.svg"><img src="{name}.svg" alt="{escape(caption)}"></a>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def write_page(path: Path, title: str, parts: Sequence[str], headline: str = "") -> None:
    """Write one HTML page of parts that are HTML already, with the contents of its headings."""
    body = "".join(parts)
    names = re.findall(r"<h2>(.*?)</h2>", body)
    for place, name in enumerate(names):
        body = body.replace(f"<h2>{name}</h2>", f'<h2 id="part-{place}">{name}</h2>', 1)
    links = (f'<li><a href="#part-{place}">{name}</a></li>' for place, name in enumerate(names))
    contents = f'<nav aria-label="contents"><ul>{"".join(links)}</ul></nav>' if names else ""
    verdict = f'<p class="verdict unknown">{escape(headline)}</p>' if headline else ""
    written = datetime.now().astimezone().isoformat(timespec="seconds")
    path.write_text(
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<link rel="icon" href="data:,"><style>{css()}</style></head><body><main>'
        f"<h1>{escape(title)}</h1>{verdict}{contents}{body}"
        f'<footer>teleop-rt {__version__} · <time datetime="{written}">'
        f"{written.replace('T', ' ')}</time></footer></main></body></html>\n",
        encoding="utf-8",
    )


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows under all their columns; unknown cells are empty."""
    columns = list(dict.fromkeys(name for row in rows for name in row))
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)


def flat(content: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested mappings as one row: `{"error": {"k": 1}}` gives `{"error_k": 1}`."""
    row: dict[str, Any] = {}
    for key, value in content.items():
        if isinstance(value, Mapping):
            row |= flat(value, f"{prefix}{key}_")
        elif not isinstance(value, list):
            row[f"{prefix}{key}"] = value
    return row
