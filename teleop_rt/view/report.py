"""The report of a run: one self-contained, printable HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teleop_rt.view import figures
from teleop_rt.view.compare import compared, force_limits
from teleop_rt.view.delay import one_way_delays
from teleop_rt.view.events import told
from teleop_rt.view.headline import tiles, verdict
from teleop_rt.view.html import render
from teleop_rt.view.plots import side_by_side
from teleop_rt.view.quantities import small_position, stiffness_units
from teleop_rt.view.residual import verdict as residual_verdict
from teleop_rt.view.residual import whiteness
from teleop_rt.view.run_folder import Run, selected_row

REPORT = "report.html"
_UNKNOWN_CUTOFF_HZ = 60.0


def write_report(run: Run) -> Path:
    """Write report.html into a run's folder, and return its path."""
    path = run.folder / REPORT
    path.write_text(render("report.html.j2", run=content(run)), encoding="utf-8")
    return path


def write_comparison(path: Path, runs: Sequence[Run]) -> Path:
    """Write a page that sets two runs side by side, and return its path."""
    limits = force_limits(runs)
    with side_by_side():
        shown = [content(run, limits) for run in runs]
    text = render(
        "compare.html.j2",
        runs=shown,
        rows=compared(runs),
        names=[str(run.folder) for run in runs],
        models=list(dict.fromkeys(model for one in shown for model in one["estimates"])),
    )
    path.write_text(text, encoding="utf-8")
    return path


def content(run: Run, limits: tuple[float, float] | None = None) -> dict[str, Any]:
    """Return everything that the page of a run shows; `limits` of the force's axis."""
    found = whiteness(run.residual[run.settled], run.step * run.period_s, _cutoff_hz(run))
    delays = one_way_delays(run.slave, run.master) if run.step == 1 else None
    flags = run.slave.get("inadequate")
    said = None if flags is None else bool(flags[-1] > 0)
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
        "verdict": verdict(run.summary, answers),
        "selected": selected_row(run.summary),
        "step": run.step,
        "residual": residual,
        "delays": delays,
        "events": told(run.events, run.start_ns, run.units),
        "surface": [
            small_position(run.summary["contact"].get(f"surface_{of}"), run.units.position)
            for of in ("found", "true")
        ],
        "force": figures.force_figure(run, limits),
        "close_force": figures.close_force_figure(run),
        "position": figures.position_figure(run),
        "estimates": figures.estimate_figures(run),
        "whiteness": None if found is None else figures.whiteness_figure(found),
        "link": None if delays is None else figures.link_figure(run, delays),
        "timing": figures.timing_figure(run),
        "energy": figures.energy_figure(run),
    }


def _cutoff_hz(run: Run) -> float:
    differentiator = run.trial.get("estimation", {}).get("differentiator", {})
    return float(differentiator.get("cutoff_hz", _UNKNOWN_CUTOFF_HZ))
