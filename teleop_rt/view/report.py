"""The report of a run: one self-contained, printable HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teleop_rt.outputs import write_whole
from teleop_rt.view import figures
from teleop_rt.view.compare import compared, different_keys, letters, overlaid
from teleop_rt.view.delay import one_way_delays
from teleop_rt.view.events import event_rows
from teleop_rt.view.headline import graded_notes, tiles, verdict
from teleop_rt.view.html import figures_of, render
from teleop_rt.view.quantities import small_position, stiffness_units
from teleop_rt.view.residual import verdict as residual_verdict
from teleop_rt.view.residual import whiteness
from teleop_rt.view.run_folder import Run, selected_row

REPORT = "report.html"
_UNKNOWN_CUTOFF_HZ = 60.0
"""Of the force's filter in figures of runs whose trial names none."""


def write_report(run: Run) -> Path:
    """Write report.html into a run's folder, and return its path."""
    path = run.folder / REPORT
    found = content(run)
    page = render("report.html.j2", run=found, **figures_of(found["charts"]))
    write_whole(path, page)
    return path


def write_comparison(path: Path, runs: Sequence[Run]) -> Path:
    """Write a page that sets runs side by side, and return its path."""
    headings, rows = compared(runs)
    names = letters(len(runs))
    text = render(
        "compare.html.j2",
        names=names,
        folders=[str(run.folder) for run in runs],
        runs=[{**content(run), "charts": ()} for run in runs],
        headings=headings,
        rows=rows,
        keys=different_keys(runs),
        **figures_of(overlaid(runs)),
    )
    write_whole(path, text)
    return path


def content(run: Run) -> dict[str, Any]:
    """Return everything that the page of a run shows."""
    found = whiteness(run.residual[run.settled], run.step * run.period_s, _cutoff_hz(run))
    delays = one_way_delays(run.slave, run.master) if run.step == 1 else None
    said = (run.summary.get("adequacy") or {}).get("inadequate")
    residual = residual_verdict(found, run.force_noise, run.units.force, said)
    answers = tiles(run, residual, delays)
    return {
        "trial": run.trial,
        "rig": run.rig,
        "units": run.units,
        "rendered_units": stiffness_units(run.units),
        "summary": run.summary,
        "software": run.summary.get("software") or {},
        "tiles": answers,
        "verdict": verdict(run.summary, answers, run.lacks),
        "notes": graded_notes(run.summary),
        "selected": selected_row(run.summary),
        "step": run.step,
        "residual": residual,
        "delays": delays,
        "events": event_rows(run.events, run.start_ns, run.units),
        "surface_error": small_position(
            (run.summary["contact"].get("worst") or {}).get("surface_error"), run.units.position
        ),
        "surface": [
            small_position(run.summary["contact"].get(f"surface_{of}"), run.units.position)
            for of in ("found", "true")
        ],
        "charts": figures.charts(run, found, delays),
    }


def _cutoff_hz(run: Run) -> float:
    differentiator = run.trial.get("estimation", {}).get("differentiator", {})
    return float(differentiator.get("cutoff_hz", _UNKNOWN_CUTOFF_HZ))
