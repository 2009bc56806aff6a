"""Friction, mass and torque lag of a drivetrain, from recordings of the rig."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.actuators.part import ActuatorPart
from teleop_rt_drivers.calibration.weights import CalibrationError
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.drivetrain import DrivetrainConfig, periods_behind
from teleop_rt_drivers.quantity import FROM_DRIVE
from teleop_rt_drivers.registry import parts_of

if TYPE_CHECKING:
    from teleop_rt.api.diagnosis import Diagnosis
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.calibration.rig_file import KeyPath
    from teleop_rt_drivers.calibration.torque_lag import TorqueLag

FOUND = {
    "coulomb_friction": ("friction_force", "coulomb_friction"),
    "stribeck_friction": ("friction_force", "coulomb_friction"),
    "viscous_friction": ("viscous_friction", "viscous_friction"),
    "tool_inertia": ("mass", "mass"),
}
"""Parameter of an effect, and the key of the drivetrain that takes it."""
REPEATS = 0.1
"""Of friction: with load, warmth and grease it changes by more than the deviation of one fit."""


def drivetrain_keys(rig: RigConfig, found: Diagnosis, recorded: RigConfig) -> dict[KeyPath, float]:
    """Return the drivetrain's keys and the friction's deviation. Raises CalibrationError.

    `recorded` is the rig as its file was during the run: the recorded force was freed of its
    drivetrain, so the findings are added to that, whatever the rig's file contains now.
    """
    section, _ = drivetrain_of(rig)
    _, before = drivetrain_of(recorded)
    values = before.model_dump()
    named = [effect for effect in found.effects if effect.name in FOUND]
    if not named:
        raise CalibrationError(
            f"diagnosis finds no friction and no inertia ({found.verdict.replace('_', ' ')}): "
            "leave the rig as it is, or record faster motion, which shows more"
        )
    for effect in named:
        parameter, key = FOUND[effect.name]
        values[key] += effect.parameters[parameter].value
        if not values[key] >= 0.0:
            raise CalibrationError(
                f"{effect.name}: {key} would be {values[key]:.3g}, below 0"
                ": record a run with the drivetrain that the rig has now"
            )
    unit = {
        "coulomb_friction": "{f}", "viscous_friction": "{f}_s_per_{x}", "mass": "{f}_s2_per_{x}",
    }  # fmt: skip
    keys: dict[KeyPath, float] = {
        (*section, f"{key}_{rig.units.fill(unit[key])}"): values[key] for key in unit
    }
    left = REPEATS * values["coulomb_friction"]
    keys["sensors", f"friction_deviation_{rig.units.force}"] = left
    return keys


def torque_lag_keys(rig: RigConfig, found: TorqueLag) -> dict[KeyPath, float]:
    """Return the keys of the torque's lag, and of the force's, by which the force waits."""
    section, before = drivetrain_of(rig)
    after = before.model_copy(update={"torque_lag_ms": found.torque_lag_ms})
    return {
        (*section, "torque_lag_ms"): found.torque_lag_ms,
        ("sensors", "force_lag_ms"): 1e-6 * rig.period_ns * periods_behind(after, rig.period_ns),
        ("sensors", "force_lag_deviation_ms"): found.deviation_ms,
    }


def drivetrain_of(rig: RigConfig) -> tuple[KeyPath, DrivetrainConfig]:
    """Return the place of the drivetrain in the rig's file, and its values."""
    for name, part in parts_of(rig.axis).items():
        section = ("axis", "parts", name, "drivetrain") if name else ("axis", "drivetrain")
        if not isinstance(part, CanopenPart | ActuatorPart) or part.force != FROM_DRIVE:
            continue
        if part.drivetrain is None:
            key = f"mass_{rig.units.fill('{f}_s2_per_{x}')}"
            raise CalibrationError(f"write `drivetrain: {{{key}: 0}}` at {'.'.join(section[:-1])}")
        return section, part.drivetrain
    raise CalibrationError(
        "the rig takes no force from its drive: there is nothing to correct"
        "; `calibrate force` is for a force sensor"
    )
