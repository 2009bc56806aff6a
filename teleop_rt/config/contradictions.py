"""Demands of the sections of a trial on each other, checked once the whole of it is known."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.config.operator import DeviceOperator, HandOperator, ProfileOperator
from teleop_rt.config.thousandths import meant_in_thousandths

if TYPE_CHECKING:
    from teleop_rt.config.trial import TrialConfig


class ContradictionError(ValueError):
    """Demands that a trial does not meet; `found` has a sentence for each."""

    def __init__(self, found: list[str]) -> None:
        super().__init__("; ".join(found))
        self.found = found


def contradictions(trial: TrialConfig) -> list[str]:
    """Return a sentence for each demand that a trial does not meet; it begins with a key, dotted.

    That key is one of the fields of a trial, and the rest of the sentence follows it; the others
    that the sentence names are dotted, too.
    """
    return [
        *_forces_out_of_order(trial),
        *_motion_out_of_range(trial),
        *_sampled_too_slowly(trial),
        *_device_unknown(trial),
    ]


def _forces_out_of_order(trial: TrialConfig) -> list[str]:
    """Return problems if noise, onset force, force cap and limit are not in rising order."""
    problems = []
    cap, limit = trial.slave.force_cap, trial.rig.limits.force_max
    onset, noise = trial.contact.onset_force, trial.rig.sensors.force_noise
    friction = trial.rig.sensors.friction_deviation
    if cap > limit:
        problems.append(f"slave.force_cap {cap} is above rig.limits.force_max {limit}")
    if onset >= cap:
        problems.append(f"contact.onset_force {onset} is not below slave.force_cap {cap}")
    if onset < 3 * noise:
        problems.append(
            f"contact.onset_force {onset} is below three times"
            f" rig.sensors.force_noise {noise}: noise would be taken for contact"
        )
    if onset < 3 * friction:
        problems.append(
            f"contact.onset_force {onset} is below three times"
            f" rig.sensors.friction_deviation {friction}: friction would be taken for contact"
        )
    return problems


def _sampled_too_slowly(trial: TrialConfig) -> list[str]:
    """Return problems if a derivative's bandwidth is too large for the rate of the loop."""
    cutoff, rate = trial.estimation.differentiator.cutoff_hz, trial.rig.rate_hz
    if cutoff < rate / 3:
        return []
    problem = (
        f"estimation.differentiator.cutoff_hz {cutoff:g} is not below a third of"
        f" rig.rate_hz {rate:g}: take less than {rate / 3:.3g} Hz, or a higher rate"
    )
    return [problem]


def _device_unknown(trial: TrialConfig) -> list[str]:
    """Return problems if damping or rate of the operator's device is unknown."""
    operator, master = trial.operator, trial.master
    if not isinstance(operator, DeviceOperator):
        missing = master.device_damping is None
        return ["master.device_damping is missing: no device says its own"] if missing else []
    if operator.rig.rate_hz != master.rate_hz:
        problem = (
            f"master.rate_hz {master.rate_hz} is not operator.rig.rate_hz"
            f" {operator.rig.rate_hz}: a device is read and driven once a cycle of the master"
        )
        return [problem]
    return []


def _motion_out_of_range(trial: TrialConfig) -> list[str]:
    """Return problems if a profile cannot fit into the rig's range for any surface."""
    operator, limits = trial.operator, trial.rig.limits
    profile = operator.intention if isinstance(operator, HandOperator) else operator
    if not isinstance(profile, ProfileOperator):
        return []
    problems = []
    scale, unit = trial.master.position_scale, trial.rig.units.position
    deepest = scale * (profile.mean + profile.amplitude)
    room = limits.position_max - limits.position_min
    if deepest > room:
        problems.append(
            f"operator: mean and amplitude make {deepest:g} {unit} of penetration, and"
            f" rig.limits leave a range of {room:g} {unit}: lower them"
            + meant_in_thousandths((profile.mean, profile.amplitude), room / scale, unit)
        )
    start = scale * profile.start
    if not limits.position_min <= start <= limits.position_max:
        problems.append(
            f"operator: start {start:g} {unit} is outside of rig.limits"
            f" {limits.position_min:g} to {limits.position_max:g} {unit}: set one within"
            + meant_in_thousandths((profile.start,), limits.position_max / scale, unit)
        )
    return problems
