"""The results of a trial, from its recording: surface, models, felt force and its lag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.estimation import watch
from teleop_rt.link.endpoint_state import NOTHING_AFTER_NS
from teleop_rt.link.troubles import NOTHING_TROUBLE, TROUBLES
from teleop_rt.metrics import error_of_size, lag_s
from teleop_rt.realtime.reading import read_topics
from teleop_rt.signals import HANDLE_TRUTH_TOPIC
from teleop_rt.trial.brief_touch import brief_touch, said_of
from teleop_rt.trial.estimators import Replayed, replay_estimators
from teleop_rt.trial.felt_force import (
    SIGNALS,
    EnvironmentForce,
    Felt,
    converged,
    felt_force,
    moves,
    read_truth,
    rows_to_compare,
)
from teleop_rt.trial.folder import RECORDING, began_at
from teleop_rt.trial.grades import grades
from teleop_rt.trial.software import software
from teleop_rt.trial.summary_notes import all_notes
from teleop_rt.trial.true_port import LAG_MARGIN_S, true_port
from teleop_rt.trial.unfelt import BOUND_SIGNALS, most_unfelt
from teleop_rt.trial.worst import since_touch, wall_offset, worst_felt, worst_surface

Array = NDArray[np.float64]

_HANDLE = HANDLE_TRUTH_TOPIC
_SIGNALS = {
    _HANDLE: ("stamp_ns", "position", "velocity", "motor_force", "hand_force"),
    "/slave": (
        "stamp_ns",
        "sample_stamp_ns",
        "position_age_ms",
        "force_age_ms",
        "tick",
        "position",
        "force",
        "valid",
        "in_contact",
        "contact_id",
        "surface",
        "selected",
        "inadequate",
        "predicted_force",
        "wake_latency_us",
        "work_us",
    ),
    "/master": (*SIGNALS, "surface", *BOUND_SIGNALS),
}
"""The signals of a summary: an hour of all signals would not fit into memory."""


def summarise(
    folder: Path,
    trial: TrialConfig,
    outcome: Mapping[str, Any],
    environment_force: EnvironmentForce | None,
) -> dict[str, Any]:
    """Return the summary of a run folder.

    `outcome` has the processes' own counts: clock, ticks, missed_ticks, link, safety.
    `environment_force` evaluates a simulated plant's environment; it is used, and truth.json is
    read, here alone.
    """
    topics = read_topics(folder / RECORDING, list(_SIGNALS), _SIGNALS)
    slave = topics.get("/slave", {})
    master = rows_to_compare(slave, topics.get("/master", {}))
    truth = read_truth(folder)
    replayed = replay_estimators(trial, slave)
    adequacy, timing = (
        adequacy_of(slave, trial.rig.period_ns * 1e-9),
        _timing(trial, slave, outcome),
    )
    summary = {
        "trial": trial.name,
        "began_at": began_at(folder),
        "software": software(),
        "clock": outcome["clock"],
        "seed": trial.seed,
        **timing,
        "contact": _contact(trial, slave, truth, replayed, outcome["safety"]["fault"]),
        "estimators": replayed.estimators,
        "selected": replayed.selected,
        "adequacy": adequacy,
        "link": judged_link(outcome["link"], timing["duration_s"]),
        "master": judge_felt_force(trial, slave, master, truth, environment_force)
        | {"unfelt": most_unfelt(trial, slave, master)}
        | {"rendering": outcome["rendering"], "late": outcome.get("master_late")}
        | {"true_port": _true_port(trial, master, topics.get(_HANDLE), truth, environment_force)},
        "safety": outcome["safety"],
        "recorder": outcome["recorder"],
        "privileges": outcome.get("privileges", []),
        "notes": all_notes(trial, slave, outcome, replayed, adequacy, truth, timing["duration_s"]),
    }
    return summary | {"grades": grades(summary)}


def _timing(
    trial: TrialConfig, slave: Mapping[str, Array], outcome: Mapping[str, Any]
) -> dict[str, Any]:
    """Return start and duration of the slave's loop, its ticks, and how late they were."""
    return {
        "start_up_s": _start_up_s(slave, outcome.get("began_ns")),
        "duration_s": _duration_s(slave),
        "planned_s": trial.duration_s,
        "interrupted": bool(outcome.get("interrupted")),
        "ticks": int(slave.get("tick", np.empty(0)).size),
        "missed_ticks": outcome["missed_ticks"],
        "late": outcome.get("late"),
        "wake_latency_us": _quantiles(slave.get("wake_latency_us")),
        "work_us": _quantiles(slave.get("work_us")),
    }


def adequacy_of(slave: Mapping[str, Array], period_s: float) -> dict[str, Any]:
    """Return whether the selected model left structure in the force, when, and for how long."""
    flags = slave.get("inadequate", np.empty(0)) > 0
    contact = slave.get("in_contact", np.empty(0)) > 0
    raised = np.flatnonzero(flags)
    touched = int(np.count_nonzero(contact))
    return {
        "inadequate": bool(flags[-1]) if raised.size or _judged(slave, period_s) else None,
        "raised": bool(raised.size),
        "first_raised_s": (
            float((slave["stamp_ns"][raised[0]] - slave["stamp_ns"][0]) * 1e-9)
            if raised.size
            else None
        ),
        "share_of_contact": int(np.count_nonzero(flags & contact)) / touched if touched else None,
    }


def _judged(slave: Mapping[str, Array], period_s: float) -> bool:
    """Return whether the daemon saw enough in contact of the model last selected to judge it."""
    if "predicted_force" not in slave:
        return False
    watched = np.isfinite(slave["predicted_force"]) & (slave["in_contact"] > 0)
    selected = slave["selected"]
    known = np.flatnonzero(np.isfinite(selected))
    others = known[selected[known] != selected[known[-1]]] if known.size else known
    watched[: others[-1] + 1 if others.size else 0] = False
    ends = np.flatnonzero(np.diff(watched, prepend=False, append=False))
    blocks = ((ends[1::2] - ends[::2]) * period_s / watch.BLOCK_S).astype(int)
    return float(np.sum(blocks)) * watch.BLOCK_S >= watch.LEAST_S


def _duration_s(slave: Mapping[str, Array]) -> float:
    stamps = slave.get("stamp_ns", np.empty(0))
    return float((stamps[-1] - stamps[0]) * 1e-9) if stamps.size else 0.0


def _start_up_s(slave: Mapping[str, Array], began_ns: int | None) -> float | None:
    stamps = slave.get("stamp_ns", np.empty(0))
    return float(stamps[0] - began_ns) * 1e-9 if began_ns is not None and stamps.size else None


def _quantiles(values: Array | None) -> dict[str, float] | None:
    """Return p50, p99, p999 and max of the finite values; None where there are none."""
    finite = values[np.isfinite(values)] if values is not None else np.empty(0)
    if finite.size == 0:
        return None
    p50, p99, p999 = np.quantile(finite, [0.5, 0.99, 0.999])
    return {"p50": float(p50), "p99": float(p99), "p999": float(p999), "max": float(finite.max())}


def _contact(
    trial: TrialConfig,
    slave: Mapping[str, Array],
    truth: Mapping[str, Any] | None,
    replayed: Replayed,
    fault: Mapping[str, Any],
) -> dict[str, Any]:
    surface = slave.get("surface", np.empty(0))
    known = surface[np.isfinite(surface)]
    true = truth["environment"]["surface"] if truth else None
    contact: dict[str, Any] = {
        "surface_found": float(known[-1]) if known.size else None,
        "surface_true": true,
        "worst": worst_surface(slave, truth),
        "unit": trial.rig.units.position,
        "onsets": int(slave["contact_id"][-1]) if "contact_id" in slave else 0,
    }
    reasons = []
    touch = brief_touch(trial, slave)
    if touch is not None:
        contact["brief_touch_ms"] = touch.longest_ms
    if not known.size:
        reasons.append(replayed.surface_reason if touch is None else said_of(touch, trial, fault))
    if true is None and trial.plant is None:
        reasons.append("the true surface of a measured environment is not known")
    elif true is None:
        reasons.append("truth.json is missing: the simulated rig did not end in good order")
    if reasons:
        contact["reason"] = "; ".join(reasons)
    return contact


def judged_link(link: Mapping[str, Any], ran_s: float) -> dict[str, Any]:
    """Return the counts of the link without a trouble that a run was too short to have.

    In a run that ended before either side misses the other, nothing had to have arrived.
    """
    judged = dict(link)
    if ran_s * 1e9 < NOTHING_AFTER_NS and link.get("trouble") == TROUBLES[NOTHING_TROUBLE][1]:
        judged["trouble"] = None
    if isinstance(link.get("master"), Mapping):
        judged["master"] = judged_link(link["master"], ran_s)
    return judged


def judge_felt_force(
    trial: TrialConfig,
    slave: Mapping[str, Array],
    master: Mapping[str, Array],
    truth: Mapping[str, Any] | None,
    environment_force: EnvironmentForce | None,
) -> dict[str, Any]:
    """Return error, lag and largest step of the rendered force, against the true environment."""
    rendered = master.get("rendered_force", np.empty(0))
    steps = np.abs(np.diff(rendered))
    result: dict[str, Any] = {
        "nrmse": None,
        "lag_ms": None,
        "direct_reflection_lag_ms": None,
        "worst": None,
        "offset": wall_offset(master, _began_ns(slave or master)),
        "largest_force_step": float(np.nanmax(steps)) if np.any(np.isfinite(steps)) else None,
    }
    if truth is None or environment_force is None:
        result["reason"] = "the true environment is not known, so the felt force has no reference"
        return result
    if not np.any(master.get("contact_id", np.empty(0)) > 0):
        result["reason"] = "the run ended before contact had converged"
        return result
    felt = felt_force(trial, master, truth, environment_force)
    began_ns = _began_ns(slave or master)
    result["worst"] = worst_felt(felt, since_touch(trial, master), began_ns)
    if np.count_nonzero(felt.converged) < 2:
        result["reason"] = "the run ended before contact had converged"
        return result
    return result | _error_and_lags(trial, felt)


def _began_ns(rows: Mapping[str, Array]) -> float:
    return float(rows["stamp_ns"][0]) if rows else 0.0


def _error_and_lags(trial: TrialConfig, felt: Felt) -> dict[str, Any]:
    """Return the error of the felt force, and its lag and that of direct reflection [ms].

    With a reason where a lag cannot be found.
    """
    period_s = 1.0 / trial.master.rate_hz
    in_contact = felt.converged & ((felt.true > 0.0) | (felt.rendered > 0.0))
    result: dict[str, Any] = {
        "nrmse": error_of_size(
            np.where(in_contact, felt.true, np.nan), np.where(in_contact, felt.rendered, np.nan)
        )
    }
    if not moves(trial, felt.true[felt.converged]):
        onset = f"{trial.contact.onset_force:g} {trial.rig.units.force}"
        still = f"contact.onset_force {onset}: it shows no lag"
        return result | {"reason": f"the true force moved by less than {still}"}
    reflected_s = trial.link.round_trip_ms * 1e-3 + LAG_MARGIN_S
    unknown = []
    for key, signal, most_s in (
        ("lag_ms", felt.rendered, LAG_MARGIN_S),
        ("direct_reflection_lag_ms", felt.reflected, reflected_s),
    ):
        lag = lag_s(felt.true[felt.converged], signal[felt.converged], period_s, most_s)
        result[key] = None if lag is None else lag * 1e3
        unknown += [key] if lag is None else []
    if unknown:
        result["reason"] = (
            f"{' and '.join(unknown)}: no lag within the search fits best: the force hardly moves, "
            "or the motion repeats itself"
        )
    return result


def _true_port(
    trial: TrialConfig,
    master: Mapping[str, Array],
    handle: Mapping[str, Array] | None,
    truth: Mapping[str, Any] | None,
    environment_force: EnvironmentForce | None,
) -> dict[str, float | None] | None:
    """Return the true force on a simulated hand; None where there is none, or no contact yet."""
    if not handle or not master or truth is None or environment_force is None:
        return None
    rows = converged(trial, master)
    if np.count_nonzero(rows) < 2:
        return None
    return true_port(trial, master, handle, truth, environment_force, rows)
