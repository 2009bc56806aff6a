"""Results of the campaign of faults as one table: a fault a row, a phase a column."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

PHASES = ("arming", "approach", "contact", "release")
HEAD = "| fault | tries | bound | " + " | ".join(PHASES) + " | ends in |"


def markdown(files: Sequence[Path]) -> str:
    """Return the rows of `--json` files as a Markdown table; a later file's row replaces."""
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for file in files:
        for one in json.loads(file.read_text(encoding="utf-8"))["rows"]:
            rows.setdefault(one["fault"], {})[one["phase"]] = one
    lines = [HEAD, "| --- " * HEAD.count(" | ") + "| --- |"]
    return "\n".join(lines + [_line(name, by_phase) for name, by_phase in rows.items()])


def _line(name: str, by_phase: dict[str, dict[str, Any]]) -> str:
    first = next(iter(by_phase.values()))
    bound = "" if first["bound_ms"] is None else f"{first['bound_ms']:g} ms"
    cells = [_cell(by_phase.get(phase)) for phase in PHASES]
    ends = "/".join(sorted({one["state"] for one in by_phase.values()} - {"-"}))
    failed = [one["problem"] for one in by_phase.values() if not one["holds"]]
    ends += f"; **fails**: {'; '.join(failed)}" if failed else ""
    tries = sum(one["seeds"] for one in by_phase.values())
    return f"| {name} | {tries} | {bound} | " + " | ".join(cells) + f" | {ends} |"


def _cell(one: dict[str, Any] | None) -> str:
    if one is None or one["detected_ms"] is None:
        return ""
    peak = "" if one["peak_force_N"] is None else f", {one['peak_force_N']:.0f} N"
    return f"{one['detected_ms']:.0f} ms{peak}"
