"""Notes of a trial's summary: warnings that its numbers do not contain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.config.trial import TrialConfig
from teleop_rt.realtime.alarms import of_recorder
from teleop_rt.trial.chatter import chatter_note
from teleop_rt.trial.estimators import Replayed
from teleop_rt.trial.grades import POOR_NRMSE, selected_nrmse
from teleop_rt.trial.late import cause
from teleop_rt.trial.simulated_wall import unmet
from teleop_rt.trial.stuck_force import stuck_force

Array = NDArray[np.float64]
STRUCTURE = (
    "model inadequate: structure is left in the force; teleop-rt diagnose names the missing effect"
)
_UNCOUPLED = (
    ("freezes", "silence on the link froze the master's target"),
    ("declutches", "the master declutched and let the force fade"),
)


def all_notes(
    trial: TrialConfig,
    slave: Mapping[str, Array],
    outcome: Mapping[str, Any],
    replayed: Replayed,
    adequacy: Mapping[str, Any],
    truth: Mapping[str, Any] | None,
    duration_s: float,
) -> list[str]:
    """Return the notes of a run that went on for `duration_s`; `truth` is the simulated plant's."""
    notes = notes_of(outcome, replayed)
    if adequacy["inadequate"]:
        notes.append(STRUCTURE)
    if truth:  # those of earlier versions had no start
        missed = unmet(trial, truth["environment"], truth.get("start", 0.0))
        notes += [str(one) for one in missed]
    notes += _over_cap(trial, slave)
    notes += chatter_note(trial, slave)
    notes += stuck_force(trial, slave)
    notes += _steps(trial, slave)
    if outcome.get("interrupted"):
        notes.append(f"interrupted after {duration_s:.2f} s of {trial.duration_s:g} s")
    return notes


def notes_of(outcome: Mapping[str, Any], replayed: Replayed) -> list[str]:
    """Return the conditions that a reader must know before trusting the figures."""
    notes = list(of_recorder(outcome["recorder"]))
    notes += [line for line in outcome.get("privileges", ()) if ": refused (" in line]
    if refused := (outcome["link"].get("master") or {}).get("rejected"):
        notes.append(f"the master refused {refused} packets: see link.master in summary.json")
    if (late := outcome.get("master_late")) is not None and late["stop"] is not None:
        stopped = f"the master was late, and stopped the device if there is one: {cause(late)}"
        notes.append(f"{stopped}; `teleop-rt doctor` measures the machine")
    rendering = outcome["rendering"] or {}
    for key, what in _UNCOUPLED:
        if count := rendering.get("engagement", {}).get(key):
            notes.append(f"{what} {count} times: see log.jsonl")
    if count := sum(rendering.get("refused_models", {}).values()):
        where = "see master.rendering.refused_models in summary.json"
        notes.append(f"the master refused {count} models: {where}")
    passivity = rendering.get("passivity")
    if passivity and passivity["missing_J"] > 0:
        what = f"a contact gave the hand {passivity['missing_J']:.3g} J more than the tank holds"
        notes.append(f"{what}: the device's own damping had to take it")
    notes += _of_handle(rendering.get("handle"))
    if rendering.get("state") == "WAITING" and not rendering.get("engagement", {}).get(
        "engagements"
    ):
        notes.append(
            "the master never engaged: nothing was rendered; log.jsonl lists states and link"
        )
    error = selected_nrmse({"estimators": replayed.estimators, "selected": replayed.selected})
    if error is not None and error > POOR_NRMSE:
        notes.append(
            f"the selected model misses the force by {100 * error:.0f} % of its range: "
            "do not trust its parameters; teleop-rt diagnose names the missing effect"
        )
    return notes


def _of_handle(handle: Mapping[str, Any] | None) -> list[str]:
    """Return the events of the operator's device."""
    if handle is None:
        return []
    notes = []
    if (fault := handle["fault"])["code"]:
        notes.append(f"{fault['name']}: {fault['cause']}; {fault['next_step']}")
    if count := handle["softenings"]:
        softer = f"the operator's device oscillated: walls were rendered softer {count} times"
        notes.append(f"{softer}; teleop-rt calibrate device measures its damping and latency")
    if handle["leash_slipped"]:
        led = "the hand pushed through the leash: it led the slave by more than leash_mm"
        notes.append(f"{led}; approach more slowly where nobody has been")
    return notes


def _over_cap(trial: TrialConfig, slave: Mapping[str, Array]) -> list[str]:
    """Return the note that the tool pressed harder than its cap: by how much, for how long."""
    if not slave:
        return []
    cap, unit = trial.slave.force_cap, trial.rig.units.force
    force = slave["force"][slave["valid"] > 0]
    over = np.flatnonzero(force > cap)
    if not over.size:
        return []
    rows = np.split(over, np.flatnonzero(np.diff(over) > 1) + 1)
    longest_ms = 1e3 * max(map(len, rows)) / trial.rig.rate_hz
    pressed = (
        f"the tool pressed with {force.max():.4g} {unit}, above slave.force_cap {cap:g} {unit}"
    )
    why = "a wall came nearer, became stiffer around the tool, or is stiffer than "
    return [f"{pressed}, for up to {longest_ms:g} ms at a time: {why}limits.stiffness_max says"]


def _steps(trial: TrialConfig, slave: Mapping[str, Array]) -> list[str]:
    """Return the note that a diagnosis of the recording gives, too, where the motion has steps."""
    if not slave or not np.any(slave["in_contact"] > 0):
        return []
    from teleop_rt.diagnosis.answers.notes import STEPS_OF_MOTION  # noqa: PLC0415 - no daemon waits for it
    from teleop_rt.diagnosis.samples.smoothing import moves_in_steps  # noqa: PLC0415 - as above
    from teleop_rt.recordings.usable import MIN_SAMPLES  # noqa: PLC0415 - as above

    fresh = (slave["valid"] > 0) & (np.diff(slave["sample_stamp_ns"], prepend=-1.0) > 0)
    position = slave["position"][fresh]
    if position.size < MIN_SAMPLES:
        return []
    found = moves_in_steps(position, slave["force"][fresh], trial.rig.period_ns * 1e-9)
    return [STEPS_OF_MOTION] if found else []
