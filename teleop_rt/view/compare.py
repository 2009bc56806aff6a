"""Two runs in one table: each figure of either, and how they differ."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from teleop_rt.view.headline import lost_share
from teleop_rt.view.quantities import SMALL, small
from teleop_rt.view.run_folder import Run, selected_row
from teleop_rt.view.style import method_name, model_name, printed, with_unit

_MANYFOLD = 10.0


def force_limits(runs: Sequence[Run]) -> tuple[float, float]:
    """Return limits of the force's axis that hold every run."""
    drawn = [run.slave["force"] for run in runs]
    drawn += [run.master["rendered_force"] for run in runs if run.master]
    forces = np.concatenate([force[np.isfinite(force)] for force in drawn])
    low, high = (float(forces.min()), float(forces.max())) if forces.size else (0.0, 1.0)
    margin = 0.05 * max(high - low, 1e-9)
    return low - margin, high + margin


def compared(runs: Sequence[Run]) -> list[dict[str, Any]]:
    """Return `{name, cells, change}` per figure: a cell for each of two runs, B against A."""
    first, second = (dict(_figures(run)) for run in runs)
    rows = []
    for name in dict.fromkeys((*first, *second)):
        values = [part.get(name, (None, "")) for part in (first, second)]
        cells = [v if isinstance(v, str) else with_unit(v, unit, 5) for v, unit in values]
        rows.append({"name": name, "cells": cells, "change": _change(*(v for v, _ in values))})
    return rows


def _figures(run: Run) -> Iterator[tuple[str, tuple[float | str | None, str]]]:
    summary = run.summary
    yield "trial", (summary["trial"], "")
    yield "rig", (str(run.rig["name"]), "")
    yield "software", (str((summary.get("software") or {}).get("version", "unknown")), "")
    yield "ended", (f"{summary['safety']['state']}, {summary['safety']['fault']['name']}", "")
    chosen = selected_row(summary)
    if chosen is not None:
        method = method_name(chosen["regression"], chosen["solver"])
        yield "selected model", (f"{model_name(chosen['model'])}, {method}", "")
        for name, parameter in chosen["parameters"].items():
            yield f"{name} [{printed(parameter['unit'])}]", (parameter["value"], "1")
        yield "force error of the model (NRMSE)", (chosen["nrmse"], "1")
    settled = run.residual[run.settled]
    known = settled[np.isfinite(settled)]
    rms = float(np.sqrt(np.mean(known**2))) if known.size else None
    yield "residual, rms", (rms, run.units.force)
    master, contact, link = summary["master"], summary["contact"], summary["link"]
    yield "felt force error (NRMSE)", (master["nrmse"], "1")
    yield "felt force lag", (master["lag_ms"], "ms")
    yield "largest force step", (master["largest_force_step"], run.units.force)
    surface, unit = contact["surface_found"], run.units.position
    yield "surface found", (None if surface is None else SMALL * surface, small(unit))
    yield "contacts", (float(contact["onsets"]), "1")
    yield "round trip", (link["round_trip_ms"], "ms")
    share = lost_share(link)
    yield "packets lost", (None if share is None else 100.0 * share, "%")
    missed = summary["missed_ticks"]
    yield "ticks missed", (None if missed is None else float(missed), "1")
    late = summary.get("late")
    yield "longest stall", (None if late is None else late["longest_stall_ms"], "ms")
    for name in ("wake_latency_us", "work_us"):
        if summary[name] is not None:
            label = name.removesuffix("_us").replace("_", " ")
            yield f"{label} p99", (summary[name]["p99"], "µs")


def _change(a: float | str | None, b: float | str | None) -> str:
    """Return what B is against A: a share where that can be told, words where they differ."""
    if isinstance(a, str) or isinstance(b, str):
        return "" if a == b else "differs"
    if a is None or b is None:
        return ""
    if a == b:
        return "same"
    if a.is_integer() and b.is_integer():
        return f"{b - a:+g}"
    if not a:
        return ""
    return f"× {b / a:.3g}" if b / a >= _MANYFOLD else f"{100.0 * (b - a) / abs(a):+.3g} %"
