"""The command `teleop-rt calibrate`: experiment, print, and write into the rig's file."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any

from teleop_rt.api.diagnosis import diagnose
from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.rig import RigConfig
from teleop_rt.trial.folder import RECORDING, TRIAL
from teleop_rt_drivers.calibration.device import device_keys, fit_device
from teleop_rt_drivers.calibration.device_motion import TOO_FAR, swing
from teleop_rt_drivers.calibration.drivetrain import drivetrain_keys, drivetrain_of, torque_lag_keys
from teleop_rt_drivers.calibration.force import any_force, force_keys, read_force, scale_in_file
from teleop_rt_drivers.calibration.lag import find_lag
from teleop_rt_drivers.calibration.rig_file import KeyPath, as_written, rewrite
from teleop_rt_drivers.calibration.shown import OF_DEVICE, lines
from teleop_rt_drivers.calibration.table import Ask, free_device, reserved, with_weights
from teleop_rt_drivers.calibration.torque_lag import find_torque_lag
from teleop_rt_drivers.calibration.weights import CalibrationError, fit_weights
from teleop_rt_drivers.operator_device import device_transport
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS

STANDARD_GRAVITY = 9.80665  # m/s2, by definition


def calibrate_force(
    file: Path,
    weights: str,
    seconds: float,
    lever_m: float | None,
    ask: Ask,
    *,
    pull: bool,
    write: bool,
    as_json: bool,
    simulated: Path | None = None,
) -> None:
    """Read the rig's force under each weight, after `ask` has had it hung; print, and write.

    Of a trial `simulated` its sensor is read, with simulated weights.
    """
    rig = load_rig(file, AXIS_SCHEMAS)
    masses = masses_of(weights)
    if (rig.units.force == "Nm") != (lever_m is not None):
        raise CalibrationError(
            "--lever-m is for rotary rigs: give it for one, and leave it out for a linear one"
        )
    raw = scale_in_file(rig).raw  # before a weight is asked for
    per_kg = STANDARD_GRAVITY * (lever_m or 1.0) * (-1.0 if pull else 1.0)
    readings = []
    with reserved(rig, simulated):
        axis, clock, hang = with_weights(file, any_force(rig) if raw else rig, simulated, ask)
        with closing(axis):
            axis.configure()
            for mass in masses:
                force = per_kg * mass
                hang(mass, force)
                with clock.paced(f"reading {mass:g} kg", rig.period_ns) as pace:
                    readings.append(read_force(axis, pace.wait, clock.now_ns, force, seconds))
    fit = fit_weights(readings, raw=raw)
    results = {**asdict(fit), "linearity": fit.linearity, "unit": rig.units.force}
    shown = lines(results, rig.units)
    finish(file, force_keys(rig, fit), results, shown, write=write, as_json=as_json)


def masses_of(text: str) -> list[float]:
    """Return masses [kg] in the order given. Raises CalibrationError."""
    try:
        masses = [float(one) for one in text.split(",")]
    except ValueError:
        raise CalibrationError(f"--weights {text}: give numbers of kg, such as 0,0.5,1") from None
    if len(set(masses)) < 2 or not all(0.0 <= mass < math.inf for mass in masses):
        raise CalibrationError(f"--weights {text}: two different masses are needed, none below 0")
    return masses


def calibrate_lag(
    file: Path, recording: Path, damping: float | None, *, write: bool, as_json: bool
) -> None:
    """Find the lag of the force, or of the drive's torque, by a recording; print, and write."""
    rig = load_rig(file, AXIS_SCHEMAS)
    recording = recording / RECORDING if recording.is_dir() else recording
    if rig.axis.force_from_drive:
        ran = _recorded(recording)
        found = find_torque_lag(recording, drivetrain_of(ran)[1], ran, damping or 0.0)
        by_motor = torque_lag_keys(rig, found)
        shown = lines(asdict(found), rig.units)
        finish(file, by_motor, asdict(found), shown, write=write, as_json=as_json)
        return
    fit = find_lag(recording, damping)
    keys: dict[KeyPath, float] = {
        ("sensors", "force_lag_ms"): fit.lag_ms,
        ("sensors", "force_lag_deviation_ms"): fit.deviation_ms,
    }
    shown = lines(asdict(fit), rig.units)
    finish(file, keys, asdict(fit), shown, write=write, as_json=as_json)


def calibrate_drivetrain(
    file: Path, recording: Path, base: str, *, write: bool, as_json: bool
) -> None:
    """Find friction and mass between motor and tool by a recording; print, and write."""
    rig, recorded = load_rig(file, AXIS_SCHEMAS), _recorded(recording)
    found = diagnose(recording, base)
    parameters = {
        f"{effect.name}.{name}": parameter
        for effect in found.effects
        for name, parameter in effect.parameters.items()
    }
    results = {name: parameter.value for name, parameter in parameters.items()}
    keys = drivetrain_keys(rig, found, recorded)
    everything = {"verdict": found.verdict, **results}
    units = {name: parameter.unit for name, parameter in parameters.items()}
    shown = lines(everything, rig.units, units)
    finish(file, keys, everything, shown, write=write, as_json=as_json)


def _recorded(recording: Path) -> RigConfig:
    """Return the rig as it was in a run. Raises CalibrationError for a recording alone."""
    folder = recording if recording.is_dir() else recording.parent
    kept = folder / TRIAL
    if not kept.is_file():
        raise CalibrationError(
            f"{recording}: {TRIAL} of the run is not beside it, which has the drivetrain that "
            "the recorded force was freed of: give the run's folder"
        )
    return load_trial(kept, AXIS_SCHEMAS, PLANT_SCHEMAS).rig


def calibrate_device(
    file: Path,
    force: float,
    reach: float,
    seconds: float,
    ask: Ask,
    *,
    write: bool,
    as_json: bool,
    simulated: Path | None = None,
) -> None:
    """Let an operator's device swing, after `ask` has had it let go; print, and write.

    Of a trial `simulated` its device swings, which nobody holds.
    """
    rig = load_rig(file, AXIS_SCHEMAS)
    transport, limits = device_transport(rig), rig.limits
    if not 0.0 < force <= limits.force_max:
        raise CalibrationError(
            f"--force {force:g}: above 0, at most force_max {limits.force_max:g}"
        )
    travel = limits.position_max - limits.position_min
    if not 0.0 < (1.0 + TOO_FAR) * reach < travel / 2.0:
        raise CalibrationError(f"--reach {reach:g}: above 0, at most an eighth of the travel")
    words = (
        f"the device will swing by about {reach:g} {rig.units.position}, pushed with {force:g} "
        f"{rig.units.force} for {seconds:g} s: put it in the middle, let go, press Enter"
    )
    with reserved(rig, simulated):
        device, clock, let_go = free_device(file, rig, simulated, ask, words)
        with closing(device):
            device.configure()
            let_go()
            with clock.paced("swinging the device", rig.period_ns) as pace:
                motion = swing(device, pace.wait, clock.now_ns, force, reach, seconds)
    fit = fit_device(motion)
    keys = device_keys(rig, transport, fit)
    shown = [*lines(asdict(fit), rig.units), OF_DEVICE]
    finish(file, keys, asdict(fit), shown, write=write, as_json=as_json)


def finish(
    file: Path,
    keys: Mapping[KeyPath, float],
    results: dict[str, Any],
    shown: Iterable[str],
    *,
    write: bool,
    as_json: bool,
) -> None:
    """Print the findings, and the keys as they are written where that is asked for.

    `shown` are the lines of the results.
    """
    named = {".".join(path): as_written(value) for path, value in keys.items()}
    kept = rewrite(file, keys) if write else None
    if as_json:
        numbers = {name: float(text) for name, text in named.items()}
        print(json.dumps({**results, "keys": numbers, "kept": None if kept is None else str(kept)}))
        return
    for line in shown:
        print(line)
    for name, text in named.items():
        print(f"{name}: {text}")
    print(f"written; the old file is {kept}" if kept else "nothing was written: --write does")
