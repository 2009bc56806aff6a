"""Closing the loop: from a run to the effect that its model lacks, and to a fresh run with it.

Errors before and after are those of the fresh run, with another seed and motion: of the force that
the slave predicts, and of the felt force. The model alone runs the same fresh trial.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from teleop_rt.config.operator import HandOperator, ProfileOperator
from teleop_rt.config.trial import TrialConfig
from teleop_rt.contact.effect import Effect
from teleop_rt.contact.effects.user import library as known_effects
from teleop_rt.diagnosis.answers import extended
from teleop_rt.diagnosis.answers.experiment import Reach
from teleop_rt.diagnosis.diagnose import diagnose, narrowed, predicted_on
from teleop_rt.diagnosis.draft.drafted import Drafted
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.report import KEYS
from teleop_rt.offline.carry_over import Diagnosed, carried_over, holds_farther
from teleop_rt.offline.drafting import write_draft
from teleop_rt.offline.load import load_any
from teleop_rt.offline.on_line_error import cause_of_error
from teleop_rt.offline.table import Table
from teleop_rt.offline.withdrawal import keep_or_withdraw
from teleop_rt.offline.write import KEPT, NOT_YET, Keep, ignore, write_diagnosis
from teleop_rt.trial.folder import RECORDING

RunTrial = Callable[[Sequence[str], Path], Mapping[str, Any]]
"""(overrides, new folder) -> summary of the trial run with these overrides beside the user's."""

_OWN = Table({}, {}, None)
_FRESH_SEED = 1000
"""Added to the trial's seed for the fresh run: other noise, the same body."""
_FRESH_FREQUENCY, _FRESH_AMPLITUDE, _FRESH_MEAN = 0.77, 0.8, 1.05
"""Factors on the profile of the fresh trial, for another motion of similar depth."""
_SHIFT_DEVIATIONS = 2.0
"""Standard deviations by which a surface must be off before that is reported."""
_LIMIT_SHARE = 0.8
"""The share of the rig's limits that a proposed motion may use."""
ANSWERS = {
    "no_missing_effect": "no missing effect was found: the model is not changed",
    "unexplained": "no known effect explains the remainder: the model is not changed",
}
DRAFTED = (
    "no known effect explains the remainder, so a law was drafted from it: name it and change it"
    " in draft_effect.py"
)
HOW = {
    "adds_force": "its amplitude is estimated on-line beside the model's parameters",
    "moves_position": "the position is corrected by the effect itself, which follows the motion",
    "deflects": "the position is corrected by the deflection under the measured force",
    "slackens": "it is not corrected on-line: it acts where the force is small",
    "filters_force": "the position is low-passed like the force before the model uses both",
    "limits_force": "it cannot be undone on-line: the samples that it spoils are left out",
    "shifts_time": "position and force are aligned by its lag",
}


@dataclass(frozen=True)
class EffectsFound:
    """The effects found in the first run's recording, and perhaps in a second one.

    `fitted_on` is the folder of the run whose recording the fit is of.
    """

    fitted_on: str
    diagnosed: Diagnosed
    answer: dict[str, Any]
    surface_shift: dict[str, Any] | None
    experiment: dict[str, Any] | None = None
    draft: Drafted | None = None

    def narrowed(self, sets: list[list[str]]) -> EffectsFound:
        """Return the class reduced to these sets."""
        recording = self.diagnosed.recording
        diagnosis = narrowed(self.diagnosed.diagnosis, recording, sets)
        return replace(self, diagnosed=Diagnosed(recording, diagnosis), answer=diagnosis.answer)


def close_loop(
    trial: TrialConfig,
    base: str,
    run: RunTrial,
    library: tuple[Effect, ...],
    out: Path,
    keep: Keep = ignore,
) -> dict[str, Any]:
    """Run, diagnose, extend, and run a fresh trial; return the answer, JSON-ready.

    Folders below `out`: first, diagnosis, perhaps experiment, and before and after for the fresh
    trial without and with the extended model, which is model.yaml unless it is withdrawn. `keep`
    gets the answer of each diagnosis. Raises the errors of `run`, and RecordingError where the
    first recording cannot be diagnosed.
    """
    run([], out / "first")
    found = _found_in(trial, base, out / "first", library)
    keep(_entries(trial, found))
    found = _written(trial, found, out / "first", out / "diagnosis")
    if found.answer["verdict"] == "class":
        found = _decide(trial, base, run, found, library, out)
    answer = _entries(trial, found)
    keep(answer)
    chosen, draft = found.answer, None
    if not chosen["effects"] and (draft := found.draft) is not None:
        chosen = {**chosen, "effects": [draft.effect], "base": draft.base}
        library = known_effects(draft.file)
        answer["reason"] = DRAFTED
    if not chosen["effects"]:
        return answer | {"reason": ANSWERS.get(chosen["verdict"], "no effect was named")}
    return answer | _on_fresh_trial(trial, base, run, out, found, chosen, library, draft)


def _entries(trial: TrialConfig, found: EffectsFound) -> dict[str, Any]:
    """Return the entries of the answer that a diagnosis alone gives."""
    return {
        "trial": trial.name,
        **{key: found.answer[key] for key in KEPT},
        "fitted_on": found.fitted_on,
        "surface_shift": found.surface_shift,
        "experiment": found.experiment,
    } | NOT_YET


def _on_fresh_trial(
    trial: TrialConfig,
    base: str,
    run: RunTrial,
    out: Path,
    found: EffectsFound,
    chosen: dict[str, Any],
    library: tuple[Effect, ...],
    draft: Drafted | None,
) -> dict[str, Any]:
    """Run the fresh trial without and with the extended model; return its errors, and the verdict.

    `chosen` holds the effects and the base that are written to model.yaml.
    """
    model = out / "model.yaml"
    extended.write(model, chosen)
    fresh = fresh_motion(trial)
    alone = [*fresh, f"estimation.models=[{base}]"]
    added = [] if draft is None else [f"effects_file={draft.file.resolve()}"]
    before = run(alone, out / "before")
    after = run([*alone, *added, f"extended_model={model.resolve()}"], out / "after")
    errors = {
        "changes": fresh,
        "slave": _on_slave(in_free_run(out / "after", found, draft), before, after),
        "master": _at_hand(before, after),
        "handled": handled(chosen, library),
    }
    runs = (out / "before" / RECORDING, out / "after" / RECORDING)
    why = partial(cause_of_error, *runs, trial.rig.units.force)
    return {"fresh": errors} | keep_or_withdraw(model, errors, why)


def in_free_run(folder: Path, found: EffectsFound, draft: Drafted | None) -> dict[str, Any]:
    """Return the errors of the force predicted on a run; without figures where nothing can be."""
    diagnosed = found.diagnosed.diagnosis
    try:
        unseen = load_any(folder / RECORDING, _OWN)
        predicted = (
            draft.predicted(unseen) if draft else predicted_on(diagnosed, unseen, named=True)
        )
    except RecordingError as error:  # the runs are finished: their other errors are not lost
        none = dict.fromkeys(("before", "after", "noise_floor"))
        return {"metric": "nrmse", **none, "reason": str(error)}
    return predicted.shown_errors


def _found_in(
    trial: TrialConfig, base: str, folder: Path, library: tuple[Effect, ...]
) -> EffectsFound:
    recording = load_any(folder / RECORDING, _OWN)
    found = diagnose(recording, base, effects=library, reach=_reach(trial, recording.surface))
    shift = _surface_shift(found.answer, recording.surface)
    return EffectsFound(folder.name, Diagnosed(recording, found), found.answer, shift)


def _written(trial: TrialConfig, found: EffectsFound, folder: Path, out: Path) -> EffectsFound:
    """Write the files of a diagnosis, and return it with the law that was drafted."""
    diagnosis, recording = found.diagnosed.diagnosis, found.diagnosed.recording
    own = Path(trial.effects_file) if trial.effects_file else None
    draft = write_draft(diagnosis, recording, out, own=own)
    write_diagnosis(diagnosis, recording, folder / RECORDING, out)
    return replace(found, draft=draft)


def _surface_shift(answer: Mapping[str, Any], online: float | None) -> dict[str, Any] | None:
    """Return by how much the run took its surface too deep (+), None where that may be chance."""
    found = answer["base"]["parameters"].get("surface")
    if online is None or found is None or found["std"] is None:
        return None
    shift = online - found["value"]
    return {**found, "value": shift} if abs(shift) > _SHIFT_DEVIATIONS * found["std"] else None


def _reach(trial: TrialConfig, surface: float | None) -> Reach | None:
    """Return the rig's allowances for a surface, None where they are not known."""
    if surface is None:
        return None
    limits = trial.rig.limits
    return Reach(
        depth=_LIMIT_SHARE * (limits.position_max - surface),
        height=_LIMIT_SHARE * (surface - limits.position_min),
        velocity=_LIMIT_SHARE * limits.velocity_max,
        force=_LIMIT_SHARE * trial.slave.force_cap,
    )


def _decide(
    trial: TrialConfig,
    base: str,
    run: RunTrial,
    first: EffectsFound,
    library: tuple[Effect, ...],
    out: Path,
) -> EffectsFound:
    """Run the proposed motion, and reduce the first recording's class by its answer."""
    proposed = first.answer["experiment"]
    if proposed is None or proposed["trial"] is None:
        return first
    motion = yaml.safe_load(Path(proposed["trial"]).read_text(encoding="utf-8"))
    operator = yaml.safe_dump(motion["operator"], default_flow_style=True, width=10_000).strip()
    changes = [f"operator={operator}", f"duration_s={motion['duration_s']}"]
    run(changes, out / "experiment")
    second = _found_in(trial, base, out / "experiment", library)
    second = _written(trial, second, out / "experiment", out / "experiment-diagnosis")
    summary = {"profile": proposed["profile"], "left_open": first.answer["class"],
               "verdict": second.answer["verdict"], "class": second.answer["class"]}  # fmt: skip
    both = [names for names in second.diagnosed.sets if names in first.diagnosed.sets]
    left = carried_over(first.diagnosed, second.diagnosed, both)
    if not left:
        return replace(first, experiment=summary)
    chosen = first if holds_farther(first.diagnosed, second.diagnosed, left[0]) else second
    return replace(chosen.narrowed(left), experiment=summary)


def fresh_motion(trial: TrialConfig) -> list[str]:
    """Return the overrides that make the fresh trial: another seed, and another motion if known."""
    changes = [f"seed={trial.seed + _FRESH_SEED}"]
    operator, unit = trial.operator, trial.rig.units.position
    if isinstance(operator, HandOperator):
        return changes + _other_profile(operator.intention, "operator.intention", unit)
    if isinstance(operator, ProfileOperator):
        return changes + _other_profile(operator, "operator", unit)
    return changes


def _other_profile(profile: ProfileOperator, key: str, unit: str) -> list[str]:
    return [
        f"{key}.frequency_hz={_FRESH_FREQUENCY * profile.frequency_hz!r}",
        f"{key}.amplitude_{unit}={_FRESH_AMPLITUDE * profile.amplitude!r}",
        f"{key}.mean_{unit}={_FRESH_MEAN * profile.mean!r}",
    ]


def _on_slave(
    free_run: Mapping[str, Any], before: Mapping[str, Any], after: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the errors of force prediction: in free run, and on-line by frozen parameters.

    Free run takes both from the first recording, and predicts the fresh one.
    """
    return {
        "free_run": free_run,
        "on_line": {"metric": "nrmse", "before": _online(before), "after": _online(after)},
    }


def _online(summary: Mapping[str, Any]) -> float | None:
    """Return the open-loop error of the selected estimator."""
    chosen = summary["selected"]
    for row in summary["estimators"]:
        if chosen and all(row[key] == chosen[key] for key in KEYS):
            error: float | None = row["nrmse"]
            return error
    return None


def _at_hand(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, Any]:
    """Return the errors of the felt force against the true environment's at the hand's motion."""
    errors: dict[str, Any] = {
        "metric": "nrmse",
        "before": before["master"]["nrmse"],
        "after": after["master"]["nrmse"],
    }
    reasons = [s["master"]["reason"] for s in (before, after) if "reason" in s["master"]]
    if (errors["before"] is None or errors["after"] is None) and reasons:
        errors["reason"] = reasons[0]
    return errors


def handled(answer: Mapping[str, Any], library: tuple[Effect, ...]) -> list[dict[str, str]]:
    """Return for each effect which side handles it, and how."""
    known = {(effect.name, effect.law): effect for effect in library}
    handlings = []
    for one in answer["effects"]:
        effect = known[one["name"], one["law"]]
        where = (
            "rendered to the operator"
            if one["belongs_to"] == "environment"
            else "kept from the operator"
        )
        handlings.append({"name": effect.name, "where": where, "how": _how(effect)})
    return handlings


def _how(effect: Effect) -> str:
    """Return how an effect is handled on-line, in words."""
    if effect.name == "contact_offset":
        return "the surface is found again"
    if effect.acts == "filters_force" and effect.compensation == "none":
        return "it is not corrected on-line: mend or calibrate the force channel"
    return HOW[effect.acts]
