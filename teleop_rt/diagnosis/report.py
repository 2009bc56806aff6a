"""A page for one diagnosis: residual before and after, ranking, figures (extra `report`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import scipy
from jinja2 import Environment
from matplotlib.figure import Figure

from teleop_rt.diagnosis import extended
from teleop_rt.diagnosis.diagnose import Diagnosis
from teleop_rt.diagnosis.held_out import counted, predict
from teleop_rt.diagnosis.verdict import explains
from teleop_rt.view.style import BLUE, VERMILLION, css

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from teleop_rt.contact.effect import Vector

_MOST_POINTS = 8000

_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Diagnosis of {{ answer.recording }}</title>
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,"><style>{{ css|safe }}</style></head><body>
<h1>Diagnosis of {{ answer.recording }}</h1>
<p>Base <b>{{ answer.base.model }}</b>, verdict <b>{{ answer.verdict }}</b>.
{% if answer.family %}Nearest family: {{ answer.family }}.{% endif %}</p>
{% for line in sentences %}<p>{{ line }}</p>{% endfor %}
{% if answer.experiment %}<p>The data cannot decide: {{ answer.experiment.why }}
(separation {{ answer.experiment.predicted_separation }}).</p>{% endif %}
<h2>Error on {{ answer.error.on }}, in free run</h2>
<table><tr><th>NRMSE (4.1) before</th><th>after</th><th>noise floor</th></tr>
<tr><td>{{ answer.error.before }}</td><td>{{ answer.error.after }}</td>
<td>{{ answer.error.noise_floor }}</td></tr></table>
<h2>Residual before and after</h2><img src="residual.svg" alt="residual before and after">
<h2>Candidates</h2><table><tr><th>effects</th><th>&Delta;BIC</th><th>explains</th></tr>
{% for row in ranking %}<tr><td>{{ row.names }}</td><td>{{ row.bic }}</td>
<td>{{ row.explains }} %</td></tr>{% endfor %}</table>
<h2>Parameters</h2><pre>{{ parameters }}</pre></body></html>
"""


def write(found: Diagnosis, folder: Path) -> list[Path]:
    """Write diagnosis.html, residual.png, residual.svg and model.yaml; returns their paths.

    `folder` is made if it is not there.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / n for n in ("diagnosis.html", "residual.png", "residual.svg", "model.yaml")]
    figure = _residuals(found)
    figure.savefig(paths[1], dpi=110)
    figure.savefig(paths[2])
    extended.write(paths[3], found.answer)
    ranking = [
        {
            "names": " + ".join(r.fit.names),
            "bic": round(r.delta_bic, 1),
            "explains": round(100.0 * explains(r, found.judgement.excess), 1),
        }
        for r in found.candidates[:15]
    ]
    page = Environment(autoescape=True).from_string(_PAGE)
    parameters = {"base": found.answer["base"], "effects": found.answer["effects"]}
    paths[0].write_text(
        page.render(
            css=css(),
            answer=found.answer,
            sentences=sentences(found),
            ranking=ranking,
            parameters=json.dumps(parameters, indent=2, allow_nan=False),
        )
    )
    return paths


def sentences(found: Diagnosis) -> list[str]:
    """Return what each effect found is, in words and figures."""
    lines = []
    for entry in found.answer["effects"]:
        told = [e for e in found.best.model.effects if e.name == entry["name"]]
        figures = {
            key: f"{p['value']:.4g} {p['unit']}".removesuffix(" 1")
            for key, p in entry["parameters"].items()
        }
        if told:
            lines.append(
                told[0].sentence.format(**figures)
                + f" It belongs to the {entry['belongs_to']}; on-line: {entry['compensation']}."
            )
    return lines


def _residuals(found: Diagnosis) -> Figure:
    """Return the figure: residual against x, velocity, t and phase, its spectrum and histogram."""
    problem, motion = found.problem, found.problem.motion
    where = np.flatnonzero(counted(problem, found.base) > 0.0)
    before = (problem.force - predict(problem, found.base))[where]
    after = (problem.force - predict(problem, found.best))[where]
    phase = np.arctan2(
        motion.v / max(float(np.std(motion.v)), 1e-300),
        (motion.x - np.mean(motion.x)) / max(float(np.std(motion.x)), 1e-300),
    )
    figure = Figure(figsize=(11, 9), layout="constrained")
    axes = figure.subplots(3, 2).ravel()
    thin = slice(None, None, 1 + where.size // _MOST_POINTS)
    for axis, row, label in zip(
        axes,
        (motion.x, motion.v, motion.t, phase),
        ("x", "velocity", "t [s]", "phase"),
        strict=False,
    ):
        _scatter(axis, row[where][thin], before[thin], after[thin], label)
    for row, label, colour in ((before, "before", VERMILLION), (after, "after", BLUE)):
        frequency, power = scipy.signal.welch(row, fs=1.0 / motion.dt, nperseg=min(2048, row.size))
        axes[4].loglog(frequency[1:], power[1:], label=label, color=colour, lw=0.8)
        axes[5].hist(row, bins=80, histtype="step", label=label, color=colour)
    axes[4].set_xlabel("frequency [Hz]")
    axes[5].set_xlabel("residual")
    axes[5].legend()
    return figure


def _scatter(axis: Axes, row: Vector, before: Vector, after: Vector, label: str) -> None:
    axis.plot(row, before, ".", ms=1, color=VERMILLION, label="before")
    axis.plot(row, after, ".", ms=1, color=BLUE, label="after")
    axis.set_xlabel(label)
    axis.locator_params(axis="x", nbins=7)
    axis.set_ylabel("residual force")
