"""The page and the tables of a study."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from teleop_rt import __version__
from teleop_rt.view.style import css, number


def table(rows: Sequence[Mapping[str, Any]], mark: str = "") -> str:
    """Return rows as an HTML table; the column `mark` gives each row its class."""
    if not rows:
        return ""
    lines = ["<tr>" + "".join(f"<th>{escape(name)}</th>" for name in rows[0]) + "</tr>"]
    for row in rows:
        kind = f' class="{escape(str(row[mark]))}"' if mark else ""
        cells = "".join(f"<td>{escape(number(value))}</td>" for value in row.values())
        lines.append(f"<tr{kind}>{cells}</tr>")
    return f"<table>{''.join(lines)}</table>"


def figure(name: str, caption: str) -> str:
    """Return a figure that lies beside the page as NAME.svg, and larger at a click."""
    return (
        f'<figure><a href="{name}.png"><img src="{name}.svg" alt="{escape(caption)}"></a>'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
    )


def write_page(path: Path, title: str, parts: Sequence[str]) -> None:
    """Write one HTML page of parts that are HTML already."""
    path.write_text(
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<link rel="icon" href="data:,">'
        f"<style>{css()}</style><body><h1>{escape(title)}</h1>{''.join(parts)}"
        f"<p>teleop-rt {__version__}</p></body></html>\n",
        encoding="utf-8",
    )


def write_csv(path: Path, rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows under all their columns; what is unknown is empty."""
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
