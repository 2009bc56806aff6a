"""Whether a trial's motion and its rig's limits meet the wall that is simulated for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from teleop_rt.config.operator import ProfileOperator
from teleop_rt.config.thousandths import meant_in_thousandths
from teleop_rt.config.trial import TrialConfig


class Unmet(NamedTuple):
    """A wall that the trial does not meet as its file means: why, the key, and the next step."""

    what: str
    key: str
    next_step: str

    def __str__(self) -> str:
        return f"{self.what}; {self.next_step}"


def unmet(trial: TrialConfig, environment: Mapping[str, Any], start: float) -> list[Unmet]:
    """Return why the wall of a simulated plant is not met by this trial, or only in part.

    `environment` has the keys of `plant.environment` without their units, in the rig's; `start` is
    the tool's true position at the start.
    """
    surface, stiffness = environment["surface"], environment["stiffness"]
    limits, units, operator = trial.rig.limits, trial.rig.units, trial.operator
    position, force = units.position, units.force
    at = f"plant.environment.surface_{position}"
    end = f"limits.position_max {limits.position_max:g} {position}"
    if surface >= limits.position_max:
        what = f"the surface at {surface:g} {position} is beyond {end}: nothing is touched"
        meant = meant_in_thousandths((surface,), limits.position_max, position)
        return [Unmet(what, at, f"set {at} below it{meant}")]
    if start > surface:
        what = f"the tool starts at {start:g} {position}, inside the body, whose surface is at "
        what += f"{surface:g} {position}: its force is taken for the sensor's zero, or arming fails"
        return [Unmet(what, at, f"set {at} above plant.start_{position}")]
    found: list[Unmet] = []
    if environment.get("hunt_crossley"):  # its stiffness depends on the depth
        return found
    most = limits.stiffness_max
    if most is not None and stiffness > most:
        name = f"limits.stiffness_max_{force}_per_{position}"
        what = f"the wall of {stiffness:g} {force}/{position} is above limits.stiffness_max"
        what += f" {most:g} {force}/{position}, to which the tool's speed is matched: a touch may"
        what += " exceed slave.force_cap"
        found.append(Unmet(what, name, "raise it to the stiffest wall that the tool can meet"))
    if not isinstance(operator, ProfileOperator):
        return found
    deepest = trial.master.position_scale * (operator.mean + operator.amplitude)
    if surface + deepest > limits.position_max:
        what = f"the operator presses {deepest:g} {position} beyond the surface, past {end}"
        found.append(Unmet(what, at, "lower operator.mean and amplitude, or move the surface"))
    cap, pressed = trial.slave.force_cap, stiffness * deepest
    if pressed > cap:
        what = f"the operator's motion would press with {pressed:.4g} {force}, and the tool yields "
        what += f"at slave.force_cap {cap:g} {force}: less of the wall is seen"
        step = f"lower operator.mean and amplitude to {cap / stiffness:.2g} {position} together"
        found.append(Unmet(what, "operator", step))
    return found
