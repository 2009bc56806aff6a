"""The report of a run: one self-contained, printable HTML page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from teleop_rt import __version__
from teleop_rt.config import TrialConfig
from teleop_rt.realtime.recording import read_topics
from teleop_rt.view.figures import force_figure, position_figure, timing_figure

REPORT = "report.html"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.5g}"


def write_report(
    folder: Path, recording: Path, trial: TrialConfig, summary: Mapping[str, Any]
) -> Path | None:
    """Write report.html into a run folder; None where nothing was recorded."""
    topics = read_topics(recording, ["/slave", "/master"])
    slave = topics.get("/slave")
    if slave is None:
        return None
    environment = Environment(
        loader=PackageLoader("teleop_rt.view", "."), autoescape=True, undefined=StrictUndefined
    )
    page = environment.get_template("report.html.j2").render(
        summary=summary,
        rig=trial.rig.name,
        version=__version__,
        number=_number,
        force=force_figure(slave, topics.get("/master", {}), trial.rig.units),
        position=position_figure(slave, trial.rig.units),
        timing=timing_figure(slave, trial.rig.period_ns * 1e-9),
    )
    path = folder / REPORT
    path.write_text(page, encoding="utf-8")
    return path
