"""Checks of a trial's values that are possible, and seldom meant."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.config.operator import DeviceOperator, HandOperator, ProfileOperator
from teleop_rt_drivers.findings import Finding

if TYPE_CHECKING:
    from teleop_rt.config.link import LinkConfig
    from teleop_rt.config.trial import TrialConfig


def check_meaning(trial: TrialConfig) -> list[Finding]:
    """Return warnings of values that a run would carry out otherwise than they are written."""
    return [*_jitter(trial.link), *_blackouts(trial), *_operator_speed(trial)]


def _jitter(link: LinkConfig) -> list[Finding]:
    if link.jitter_ms <= link.round_trip_ms:
        return []
    what = (
        f"a jitter of {link.jitter_ms:g} ms is wider than link.round_trip_ms"
        f" {link.round_trip_ms:g}: no packet comes before it is sent, so delays are cut off at 0"
    )
    step = "lower it, or raise link.round_trip_ms to it"
    return [Finding("warning", what, "link.jitter_ms", step)]


def _blackouts(trial: TrialConfig) -> list[Finding]:
    late = [start_s for start_s, _ in trial.link.blackouts_s if start_s >= trial.duration_s]
    if not late:
        return []
    what = f"the interval from {late[0]:g} s begins after the run's end, duration_s"
    what += f" {trial.duration_s:g}"
    step = "begin it earlier, or raise duration_s"
    return [Finding("warning", what, "link.blackouts_s", step)]


def _operator_speed(trial: TrialConfig) -> list[Finding]:
    """Warn where the operator moves faster than the tool may: the hand then runs away from it."""
    operator, key = trial.operator, "operator"
    if isinstance(operator, DeviceOperator) and operator.hand is not None:
        operator, key = operator.hand, "operator.hand"
    if isinstance(operator, HandOperator):
        operator, key = operator.intention, f"{key}.intention"
    if not isinstance(operator, ProfileOperator):
        return []
    most, unit = trial.rig.limits.velocity_max, trial.rig.units.position
    swing = 2 * math.pi * operator.frequency_hz * operator.amplitude
    speeds = {
        f"approach_speed_{unit}_per_s": operator.approach_speed,
        "frequency_hz": swing,
    }
    return [
        Finding(
            "warning",
            f"the operator moves the tool with {trial.master.position_scale * speed:.3g} {unit}/s,"
            f" and limits.velocity_max lets it move with {most:g} {unit}/s: the hand runs ahead of"
            " the tool, and feels a wall late and hard",
            f"{key}.{name}",
            "lower it",
        )
        for name, speed in speeds.items()
        if trial.master.position_scale * speed > most
    ]
