"""Findings of `check` and `doctor` on configs, machines and buses."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import typer

from teleop_rt.config.loader import load_rig, load_trial
from teleop_rt.config.operator import DeviceOperator
from teleop_rt.config.rig import RigConfig
from teleop_rt.config.trial import TrialConfig
from teleop_rt.config.yaml_file import ConfigError, ConfigProblem, read_yaml
from teleop_rt.errors import BAD_INPUT, FAULT
from teleop_rt.realtime.rig_locks import devices_held
from teleop_rt.terminal import ElapsedLine, red
from teleop_rt_drivers.actuators.survey import survey_lines
from teleop_rt_drivers.bus import UNIX, open_bus
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.canopen.survey import NO_ANSWER, SILENT_BUS
from teleop_rt_drivers.check import (
    check_first_touch,
    check_link,
    check_network,
    check_placeholders,
    check_rig,
    check_simulated_wall,
)
from teleop_rt_drivers.device_check import check_device
from teleop_rt_drivers.doctor import (
    NOT_OPENED,
    examine_axis,
    frame_names,
    survey_buses,
)
from teleop_rt_drivers.findings import Finding, worst
from teleop_rt_drivers.framed.stream import SerialStream
from teleop_rt_drivers.link_check import examine_link
from teleop_rt_drivers.machine_check import examine_machine
from teleop_rt_drivers.observed_bus import ObservingEnds
from teleop_rt_drivers.opening import open_axis_on
from teleop_rt_drivers.pace import paced
from teleop_rt_drivers.quantity import FROM_DRIVE
from teleop_rt_drivers.recording import RecordingAxisConfig
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS, CanBusPart, parts_of, reached_by
from teleop_rt_drivers.stall_check import check_hardware_stalls
from teleop_rt_drivers.trial_check import check_meaning


def check_config(config: Path, overrides: list[str] | None, *, as_json: bool) -> None:
    """Print all that can be known of a config without moving anything."""
    rig, trial = _load(config, overrides)
    findings = check_rig(rig, None if trial is None else trial.slave.force_cap)
    if trial is not None:
        findings += check_first_touch(trial) + check_simulated_wall(trial) + check_link(trial.link)
        findings += check_meaning(trial)
        if trial.plant is None and not isinstance(rig.axis, RecordingAxisConfig):
            findings += check_hardware_stalls(rig, "")
            if not between_processes(rig):
                findings += check_network(trial.link)
        if isinstance(trial.operator, DeviceOperator):
            for found in check_rig(trial.operator.rig):
                findings.append(replace(found, where=f"operator.rig.{found.where}"))
            findings += check_device(trial, trial.operator)
            if trial.operator.hand is None:
                findings += check_hardware_stalls(trial.operator.rig, "operator.rig.")
    _print(findings, as_json=as_json)
    if worst(findings) == "error":
        raise typer.Exit(BAD_INPUT)


def examine(config: Path, overrides: list[str] | None, cycles: int, *, as_json: bool) -> None:
    """Print the measured behaviour of this machine, the rig's buses and the link.

    Raises BusyError, before anything is measured or sent, while another process holds the rig:
    a second master on its buses would stop a moving axis.
    """
    rig, trial = _load(config, overrides)
    with devices_held(reached_by(rig)):
        findings = _measured(rig, cycles)
    if trial is not None:
        with paced("measuring the link", rig.period_ns) as pace:
            findings += examine_link(trial, pace.wait)
        if trial.plant is not None:
            findings = simulation_first(findings, f"teleop-rt sim {config}")
    elif between_processes(rig):
        command = f"teleop-rt sim silicone_cube --set rig={config.resolve()}"
        findings = simulation_first(findings, command)
    _print(findings, as_json=as_json)
    if worst(findings) == "error":
        raise typer.Exit(FAULT)


def _measured(rig: RigConfig, cycles: int) -> list[Finding]:
    """Return the findings on this machine, and on the rig's buses and devices."""
    with ElapsedLine("measuring how late a bare loop wakes") as line:
        findings = check_placeholders(rig) + examine_machine(rig, between=line.tick)
    with ElapsedLine("asking who answers on the buses") as line:
        findings += survey_buses(rig, open_bus, time.monotonic_ns)
        line.tick()
        findings += survey_lines(rig, SerialStream, time.monotonic_ns)
    return without_repeats(findings + _examine_rig(rig, cycles))


def without_repeats(findings: list[Finding]) -> list[Finding]:
    """Return the findings without the advice on an axis whose nodes were found silent before."""
    silent = any(one.where == SILENT_BUS and one.what.endswith(NO_ANSWER) for one in findings)
    if not silent:
        return findings
    what = "the axis cannot be opened without the nodes that do not answer"
    step = "follow the error of the bus, then run doctor again"
    return [
        Finding("error", what, one.where, step)
        if one.severity == "error" and one.where == "devices"
        else one
        for one in findings
    ]


def between_processes(rig: RigConfig) -> bool:
    """Return whether a bus of the rig is one between processes, on which devices are simulated."""
    buses = [part.bus for part in parts_of(rig.axis).values() if isinstance(part, CanBusPart)]
    return any(bus.interface == UNIX for bus in buses)


def simulation_first(findings: list[Finding], command: str) -> list[Finding]:
    """Return the findings on a simulated rig; errors of its devices after their usual cause.

    `command` starts its devices.
    """
    if not any(one.severity == "error" and one.where == "devices" for one in findings):
        return findings
    what = "this rig is simulated, and its devices cannot be used: the errors below may follow"
    step = f"if it is not running, start it first: {command}"
    return [Finding("warning", what, "simulation", step), *findings]


def _examine_rig(rig: RigConfig, cycles: int) -> list[Finding]:
    """Read the axis for some cycles, with its buses observed."""
    parts = parts_of(rig.axis)
    syncs = {n: p.daemon.sync_cob_id for n, p in parts.items() if isinstance(p, CanopenPart)}
    ends = ObservingEnds(syncs)
    axis = open_axis_on(rig, time.monotonic_ns, ends)

    def begin() -> None:
        for bus in ends.observed.values():
            bus.forget()

    has_sensor = not any(getattr(part, "force", None) == FROM_DRIVE for part in parts.values())
    try:
        with paced("reading the devices", rig.period_ns) as pace:
            findings = examine_axis(axis, pace.wait, cycles, begin=begin, has_sensor=has_sensor)
    finally:
        axis.close()
    if NOT_OPENED in findings[0].next_step:
        return findings  # nothing was read, so that no frame can have come
    for name, bus in ends.observed.items():
        findings += bus.timing(frame_names(parts[name]), rig.period_ns * 1e-9)
    return findings


def _load(config: Path, overrides: list[str] | None) -> tuple[RigConfig, TrialConfig | None]:
    """Load a trial with its rig, or a rig alone. Raises ConfigError."""
    data = read_yaml(config).data
    if isinstance(data, dict) and "rig" not in data and "axis" in data:
        if overrides:
            raise ConfigError(
                [
                    ConfigProblem(
                        f"--set {overrides[0]}",
                        "works on a trial: name one, or change the rig's file",
                    )
                ]
            )
        return load_rig(config, AXIS_SCHEMAS), None
    trial = load_trial(config, AXIS_SCHEMAS, PLANT_SCHEMAS, overrides or ())
    return trial.rig, trial


def _print(findings: list[Finding], *, as_json: bool) -> None:
    if as_json:
        content = {
            "worst": worst(findings),
            "findings": [finding.as_dict() for finding in findings],
        }
        print(json.dumps(content))
    else:
        for finding in findings:
            print(red(str(finding)) if finding.severity == "danger" else finding)
