"""Tables, verdicts, figures and the page of `study chapter4`."""

from __future__ import annotations

import importlib.util
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teleop_rt.batch.workers import Result
from teleop_rt.study import excitation, noise
from teleop_rt.study.chapter4_cube_statements import silicone_statements
from teleop_rt.study.chapter4_plant import TRUTH
from teleop_rt.study.chapter4_statements import Agreement, Statement, simulation_statements
from teleop_rt.study.page import figure, flat, table, write_csv, write_page
from teleop_rt.trial.folder import write_json

_NOTE = (
    "<p>Simulations run as the report's did: exact motion, SI units, P(0) = 1e6 I, no noise. "
    "The cube on the rig is pressed in a lock-step trial, through buses and bytes, and identified "
    "by the rows that run on-line; the curved cube (k = 14000, b = 160, n = 1.3) is pressed in "
    "closed form. Verdicts and reasons are computed from the tables below.</p>"
)


def judge(simulated: Sequence[Result], pressed: Sequence[Result]) -> list[Statement]:
    """Hold the report's statements against results; those on the cube where it was pressed."""
    conditions = [
        excitation.evaluate(
            {"model": model, "mean_m": mean, "amplitude_m": amplitude, "frequency_hz": 3.0,
             "bias": bias, "duration_s": 2.0}
        )
        for model in ("kelvin-voigt", "mass-spring-damper")
        for mean, amplitude, bias in ((0.0, 0.008, False), (0.005, 0.001, False),
                                      (0.005, 0.001, True))
    ]  # fmt: skip
    found = list(simulation_statements(simulated, conditions, noise.hidden_damping()))
    if pressed:
        found += silicone_statements(*pressed)
    return found


def write_report(
    folder: Path, simulated: Sequence[Result], pressed: Sequence[Result]
) -> list[Statement]:
    """Write statements.json, CSV tables, figures where they can be drawn, and chapter4.html."""
    statements = judge(simulated, pressed)
    write_json(folder / "statements.json", [one.plain() for one in statements])
    write_csv(folder / "statements.csv", [one.plain() for one in statements])
    rows = [one.plain() for one in statements]
    parts = [_NOTE, "<h2>Statements of the report</h2>", table(rows, "verdict")]
    if importlib.util.find_spec("matplotlib") is not None:
        from teleop_rt.study.chapter4_figures import (  # noqa: PLC0415 - an extra may be absent
            CAPTIONS,
            write_figures,
        )

        write_figures(folder, simulated, pressed)
        drawn = [name for name in CAPTIONS if (folder / f"{name}.svg").is_file()]
        parts += ["<h2>Figures</h2>", *(figure(name, CAPTIONS[name]) for name in drawn)]
    for model in TRUTH:
        rows = _rows([one for one in simulated if one["model"] == model], ("frequency_hz",))
        write_csv(folder / f"table_{model}.csv", rows)
        parts += [f"<h2>Simulations of {model}</h2>", table(rows)]
        if pressed:
            rows = _rows(pressed, ("specimen",), model)
            write_csv(folder / f"table_cube_{model}.csv", rows)
            parts += [f"<h2>Cubes, identified as {model}</h2>", table(rows)]
    counts = Counter(one.verdict for one in statements)
    words: dict[Agreement, str] = {"agrees": "agree", "in part": "in part", "disagrees": "disagree"}
    headline = ", ".join(f"{counts[one]} {word}" for one, word in words.items() if counts[one])
    title = "Chapter 4, repeated"
    write_page(folder / "chapter4.html", title, parts, f"Of its statements: {headline}.")
    return statements


def _rows(results: Sequence[Result], keys: Sequence[str], model: str = "") -> list[dict[str, Any]]:
    """Return a row for each method of each result, without its traces."""
    return [
        {key: result[key] for key in keys}
        | flat({key: value for key, value in one.items() if key not in {"trace", "force"}})
        for result in results
        for one in result["methods"]
        if not model or one["model"] == model
    ]
