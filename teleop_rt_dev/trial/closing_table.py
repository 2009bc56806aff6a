"""The table of the closing campaign: the hidden effect, the answer, and the errors with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

_LEGEND = """
right: the hidden effect is named. class: one of several that the data cannot distinguish.
partial: named, with something left. spurious: named beside one that is not there. wrong: another
name. unexplained, missed: no name. Errors are NRMSE on the fresh trial, before -> after: force
predicted by the slave in free run and on-line, and force felt at the hand. lamp: when the first
run said "model inadequate"."""


def show(rows: Sequence[Mapping[str, Any]], clean: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of hidden effects and the count over clean plants."""
    head = f"{'hidden':28} {'worth':11} {'named':48} {'free run':17} {'floor':7} {'on-line':17}"
    lines = [f"{head} {'felt':17} lamp"]
    lines += [_line(row) for row in rows]
    if clean:
        named = sum(row["verdict"] != "no_missing_effect" for row in clean)
        lit = sum(bool(row["lamp"]) for row in clean)
        lines.append(
            f"nothing hidden, {len(clean)} runs: {named} found an effect, {lit} lit the lamp"
        )
    return "\n".join(lines) + "\n" + _LEGEND


def _line(row: Mapping[str, Any]) -> str:
    found = row["class"] or [row["named"]]
    named = " | ".join("+".join(names) for names in found)
    lamp = "-" if row["lamp_s"] is None else f"{row['lamp_s']:.1f} s"
    errors = [_pair(row[key]) for key in ("free_run", "on_line", "felt")]
    floor = "-" if row["floor"] is None else f"{row['floor']:.4f}"
    line = (
        f"{row['hidden']:28} {row['worth']:11} {named[:48]:48} {errors[0]:17} {floor:7} "
        f"{errors[1]:17} {errors[2]:17} {lamp}"
    )
    return f"{line}\n{'':28} withdrawn: {row['withdrawn']}" if row["withdrawn"] else line


def _pair(pair: Sequence[float | None] | None) -> str:
    if pair is None:
        return "-"
    before, after = ("-" if value is None else f"{value:.4f}" for value in pair)
    return f"{before} -> {after}"
