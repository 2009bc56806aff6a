"""The delay study as tables in Markdown: the best mode of each cell, and each mode's totals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import mean
from typing import TYPE_CHECKING

from teleop_rt.batch.workers import Result

if TYPE_CHECKING:
    from teleop_rt.study.delay import Gains


def tables(results: Sequence[Result], gains: Gains) -> str:
    """Return tables of the best modes, the figures of each mode, and any reflected shares."""
    modes = sorted({r["mode"] for r in results})
    parts = [_places(modes, results), _modes(modes, results)]
    return "\n".join([*parts, _shares(gains)] if gains else parts)


def _places(modes: Sequence[str], results: Sequence[Result]) -> str:
    """Return a row per place: the mean NRMSE where every seed is stable, the least in bold."""
    lines = _head(["environment", "round trip / ms", "loss", *modes])
    for place in sorted({_place(r) for r in results}):
        here = [r for r in results if _place(r) == place]
        errors = {mode: _error([r for r in here if r["mode"] == mode]) for mode in modes}
        least = min((e for e in errors.values() if isinstance(e, float)), default=None)
        cells = []
        for error in errors.values():
            shown = f"{error:.4f}" if isinstance(error, float) else error
            cells.append(f"**{shown}**" if error == least else shown)
        environment, trip, loss = place
        lines.append(_row([environment, f"{trip:.0f}", f"{loss:.0%}", *cells]))
    return "\n".join(lines) + "\n"


def _place(result: Result) -> tuple[str, float, float]:
    return result["environment"], result["round_trip_ms"], result["loss"]


def _shares(gains: Gains) -> str:
    """Return the largest share of the force that is stable without delay, a row per mode."""
    environments = sorted({name for _, name in gains})
    lines = _head(["share of the force", *environments])
    for mode in sorted({mode for mode, _ in gains}):
        shares = [f"{gains[mode, name]:.1f}" for name in environments]
        lines.append(_row([mode, *shares]))
    return "\n".join(lines) + "\n"


def _error(own: Sequence[Result]) -> float | str:
    """Return the mean NRMSE of cells that are all stable, else how many are."""
    if not own:
        return "-"
    stable = sum(r["stable"] for r in own)
    if stable < len(own):
        return f"{stable} of {len(own)} stable"
    return float(mean(r["nrmse"] for r in own))


def _modes(modes: Sequence[str], results: Sequence[Result]) -> str:
    """Return a row per mode: cells, stable ones, the largest figures of these, and why not."""
    lines = _head(
        ["mode", "cells", "stable", "NRMSE", "NRMSE, transient", "lag / ms", "why not stable"]
    )
    for mode in modes:
        own = [r for r in results if r["mode"] == mode]
        stable = [r for r in own if r["stable"]]
        largest = [_largest(stable, name) for name in ("nrmse", "nrmse_transient", "lag_ms")]
        reasons = Counter(reason for r in own for reason in r["unstable_because"])
        why = ", ".join(f"{reason} ({count})" for reason, count in reasons.most_common())
        lines.append(_row([mode, str(len(own)), str(len(stable)), *largest, why or "-"]))
    return "\n".join(lines) + "\n"


def _largest(results: Sequence[Result], name: str) -> str:
    sizes = [abs(r[name]) for r in results if r[name] is not None]
    return f"{max(sizes):.3g}" if sizes else "-"


def _head(names: Sequence[str]) -> list[str]:
    return [_row(names), "|" + " --- |" * len(names)]


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
