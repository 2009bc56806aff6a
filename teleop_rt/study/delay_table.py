"""The delay study as tables in Markdown: which mode wins where, and what each mode comes to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import mean

from teleop_rt.study.sweep import Result


def tables(results: Sequence[Result]) -> str:
    """Return both tables; a place is an environment and a round trip, with any loss and seed."""
    modes = sorted({r["mode"] for r in results})
    return f"{_places(modes, results)}\n{_modes(modes, results)}"


def _places(modes: Sequence[str], results: Sequence[Result]) -> str:
    """Return a row per place: the mean NRMSE where every cell is stable, the least in bold."""
    lines = _head(["environment", "round trip / ms", *modes])
    for environment, trip in sorted({(r["environment"], r["round_trip_ms"]) for r in results}):
        here = [r for r in results if (r["environment"], r["round_trip_ms"]) == (environment, trip)]
        errors = {mode: _error([r for r in here if r["mode"] == mode]) for mode in modes}
        least = min((e for e in errors.values() if isinstance(e, float)), default=None)
        cells = []
        for error in errors.values():
            shown = f"{error:.4f}" if isinstance(error, float) else error
            cells.append(f"**{shown}**" if error == least else shown)
        lines.append(_row([environment, f"{trip:.0f}", *cells]))
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
