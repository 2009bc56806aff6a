"""Results of the bank, as the summary and the replay report them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from teleop_rt.config.parameter_words import reached_by
from teleop_rt.contact.effect import Vector
from teleop_rt.estimation.layout import STATUS_NAMES, WARMING_UP
from teleop_rt.estimation.pipeline import Pipeline
from teleop_rt.estimation.rows import OFFSET, RowSpec
from teleop_rt.estimation.settling import settling_times
from teleop_rt.estimation.trace import Trace
from teleop_rt.estimation.tracking import stiffness_delays

KEYS = ("model", "regression", "solver", "effects")
"""The keys that identify a row of a report."""
UNCERTAIN = "uncertain"
_UNKNOWN = ("warming up", "restarted")
"""States in which a row has no parameters."""


def _number(value: float | None) -> float | None:
    """Return a number that JSON can hold: null if it is not finite."""
    return value if value is not None and math.isfinite(value) else None


def _unit(row: RowSpec, name: str, position: str, force: str) -> str:
    """Return the unit of a parameter of a row on a rig with these units."""
    units = {p.name: p.unit for p in (*row.parameters, OFFSET)}
    return units[name].replace("{x}", position).replace("{f}", force)


def _status(status: str, deviations: Vector | None) -> str:
    """Return the status of a row with these deviations (None: not known).

    A row has deviations once it was ready. It is no longer ready where its data were taken with a
    surface since found elsewhere: its parameters are less certain then, as their deviations show.
    """
    return UNCERTAIN if status == STATUS_NAMES[WARMING_UP] and deviations is not None else status


def report_row(pipeline: Pipeline, index: int, position: str, force: str) -> dict[str, Any]:
    """Return one row as in summary.json; see `report`."""
    row = pipeline.rows[index]
    names, values, deviations = pipeline.estimate(index)
    status = _status(pipeline.status[index], deviations)
    unknown = status in _UNKNOWN
    parameters = {}
    for i, name in enumerate(names):
        std = None if deviations is None else float(deviations[i])
        parameters[name] = {
            "value": None if unknown else _number(float(values[i])),
            "std": None if unknown else _number(std),
            "unit": _unit(row, name, position, force),
        }
        if name in {"k", "b", "m", "n"} and not unknown and (std is not None or values[i] < 0.0):
            parameters[name]["identified"] = bool(values[i] > 2.0 * (std or 0.0))
    out = {
        "model": row.model,
        "regression": row.regression,
        "solver": row.solver,
        "effects": row.effects_are,
        "parameters": parameters,
        "status": status,
        "nrmse": _number(pipeline.nrmse(index)),
        "restarts": int(pipeline.restarts[index]),
        "forgetting_factor": _number(float(pipeline.lambda_[index])),
        "condition": _number(pipeline.condition(index)),
    }
    if not row.linear and not pipeline.contact.surface_known:
        out["reason"] = "not identifiable without a surface: " + (pipeline.surface_reason or "")
    return out


def report(pipeline: Pipeline, position: str = "m", force: str = "N") -> list[dict[str, Any]]:
    """Return all rows as in summary.json, JSON-ready: null where a value is not known.

    position, force: the rig's units. `identified` accompanies k, b, m and n
    that have a standard deviation: whether they are positive by two of them. A negative one is not.
    """
    return [report_row(pipeline, i, position, force) for i in range(len(pipeline.rows))]


def identified(row: Mapping[str, Any]) -> bool:
    """Return whether a reported row may be believed: it is estimated, and so are k, b, m and n."""
    found = row["parameters"].values()
    return row["status"] in {"estimated", "held"} and all(
        one["value"] is not None and one.get("identified", True) for one in found
    )


def worth_selecting(row: Mapping[str, Any]) -> bool:
    """Return whether a reported row may be called the one that was selected.

    Its stiffness must be identified, or the mass of a model that has no stiffness: a body may be
    without damping, and a spring with a damper without mass.
    """
    parameters = row["parameters"]
    leading = parameters.get("k", parameters.get("m", {"value": None}))
    return leading["value"] is not None and leading.get("identified", True)


def best_first(
    rows: Sequence[Mapping[str, Any]], selected: Mapping[str, Any] | None
) -> list[Mapping[str, Any]]:
    """Return reported rows in order: the selected one, identified ones, the others; by NRMSE.

    A row that has predicted no contact yet counts as one whose error is the whole range.
    """

    def place(row: Mapping[str, Any]) -> tuple[bool, bool, bool, float]:
        chosen = selected is not None and all(row[key] == selected[key] for key in KEYS)
        error = row["nrmse"]
        known = row["status"] in {"estimated", "held"}
        return not chosen, not identified(row), not known, 1.0 if error is None else error

    return sorted(rows, key=place)


def report_with_delays(
    pipeline: Pipeline, trace: Trace, position: str = "m", force: str = "N"
) -> list[dict[str, Any]]:
    """Return `report` after a run, with `convergence_s` and `tracking_delay_s` of each row.

    The delay is null where the body's stiffness does not vary, or the row does not follow it.
    """
    rows = report(pipeline, position, force)
    deepest = _deepest(trace)
    times = zip(settling_times(trace), stiffness_delays(trace), strict=True)
    for row, (settled_s, delay_s) in zip(rows, times, strict=True):
        row["convergence_s"] = None if row["status"] in _UNKNOWN else settled_s
        row["tracking_delay_s"] = delay_s
        _add_reached(row["parameters"], deepest)
    return rows


def _deepest(trace: Trace) -> float:
    """Return the largest depth in contact beyond a known surface [rig unit], 0 without any."""
    touching, _, surface, depth = trace.signals[:, :4].T
    known = (touching > 0.0) & np.isfinite(surface)
    return float(np.max(depth, initial=0.0, where=known))


def _add_reached(parameters: dict[str, Any], depth: float) -> None:
    """Add to stiffness and damping of a power law their values at a depth that was reached."""
    exponent = parameters.get("n", {"value": None})["value"]
    for name in ("k", "b"):
        one = parameters.get(name, {"value": None})
        if exponent is not None and one["value"] is not None:
            one |= reached_by(one["unit"], one["value"], {"n": exponent}, depth)
