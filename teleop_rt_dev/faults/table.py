"""Results of the campaign of faults, and these as one table: a fault a row, a phase a column."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

PHASES = ("arming", "approach", "contact", "release")
HEAD = "| fault | tries | bound | " + " | ".join(PHASES) + " | ends in |"


def result(fault: str, tries: int, problem: str, state: str, **more: Any) -> dict[str, Any]:
    """Return a row of the campaign; `more` replaces values that not every row has."""
    return {
        "fault": fault, "phase": "-", "clock": "simulated", "seeds": tries, "played": tries,
        "detected_ms": None, "bound_ms": None, "state": state, "named": "-",
        "peak_force_N": None, "problem": problem, "holds": not problem,
    } | more  # fmt: skip


def markdown(files: Sequence[Path]) -> str:
    """Return the rows of `--json` files as a Markdown table; a later row replaces its like."""
    rows: dict[str, dict[str, dict[str, Any]]] = {}
    for one in (one for file in files for one in saved(file)):
        rows.setdefault(one["fault"], {})[one["phase"]] = one
    lines = [HEAD, "| --- " * HEAD.count(" | ") + "| --- |"]
    return "\n".join(lines + [_line(name, by_phase) for name, by_phase in rows.items()])


def saved(file: Path) -> Iterator[dict[str, Any]]:
    """Give the rows of a file, whose last line may have been cut off."""
    for line in file.read_text(encoding="utf-8").splitlines(keepends=True):
        if line.endswith("\n") and "fault" in (one := json.loads(line)):
            yield one


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
    took = "never" if one["detected_ms"] < 0 else f"{one['detected_ms']:.0f} ms"
    return f"{took}{peak}"
