"""Rendering limits of an operator's device, before it moves: latency, damping, stiffest wall."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt.master.build import make_port
from teleop_rt.master.passivity import PassivityBound, Port
from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
from teleop_rt_drivers.canopen.config import CanopenDeviceConfig
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.operator_device import device_axis, device_transport
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
from teleop_rt_drivers.transport import DEFAULT_BIT_RATE, answer_bits, question_bits, timing_of

if TYPE_CHECKING:
    from teleop_rt.axis import Timing
    from teleop_rt.config.operator import DeviceOperator
    from teleop_rt.config.trial import TrialConfig

_AXIS = "operator.rig.axis"


def check_device(trial: TrialConfig, operator: DeviceOperator) -> list[Finding]:
    """Return findings on a trial's device: latency, damping, walls."""
    rig = operator.rig
    try:
        timing = timing_of(device_transport(rig), rig)
    except AxisError as error:
        what, _, step = str(error).removeprefix(f"{_AXIS}: ").partition("; ")
        return [Finding("error", what, _AXIS, step or "correct the key that it names")]
    findings = [_latency(timing), *_too_soon(trial, operator, timing), *_enabling(operator)]
    port = make_port(trial.master, 1.0 / trial.master.rate_hz, operator, timing)
    return [*findings, *_walls(trial, port)]


def _latency(timing: Timing) -> Finding:
    age, delay = 1e3 * timing.sample_age_s, 1e3 * timing.force_delay_s
    what = f"a force answers a motion {age + delay:.2f} ms later: a sample is {age:.2f} ms old, and"
    return Finding(
        "ok", f"{what} its force acts {delay:.2f} ms later, at worst", "operator.rig.axis"
    )


def _too_soon(trial: TrialConfig, operator: DeviceOperator, timing: Timing) -> list[Finding]:
    """Refuse a latency that bus and frames cannot do."""
    findings, axis = [], device_axis(operator.rig)
    if isinstance(axis, CanopenDeviceConfig):
        fewer = ", or map fewer objects"
        findings += _answers(axis, answer_bits(axis), "the answers to SYNC", fewer)
    elif isinstance(axis, ActuatorDeviceConfig):
        findings += _answers(axis, question_bits(axis, operator.rig), "question and answer", "")
    declared_ms, computed_ms = trial.master.device_delay_ms, 1e3 * timing.latency_s
    if 0.0 < declared_ms < computed_ms:
        what = f"{declared_ms:g} ms is below the {computed_ms:.2f} ms that bus and drive can do"
        step = "leave the key out: the driver computes it"
        findings.append(Finding("error", what, "master.device_delay_ms", step))
    return findings


def _answers(
    axis: CanopenDeviceConfig | ActuatorDeviceConfig, bits: float, frames: str, or_else: str
) -> list[Finding]:
    """Refuse a wait for answers that ends before they can be there."""
    needed_ms = 1e3 * bits / (axis.bus.bitrate or DEFAULT_BIT_RATE)
    if axis.answer_within_ms is None or axis.answer_within_ms >= needed_ms:
        return []
    what = f"{axis.answer_within_ms:g} ms is less than the {needed_ms:.3f} ms that {frames} are"
    step = f"set answer_within_ms to {1e-2 * math.ceil(1e2 * needed_ms):.2f} or more{or_else}"
    return [Finding("error", f"{what} on the bus", "operator.rig.axis.answer_within_ms", step)]


def _enabling(operator: DeviceOperator) -> list[Finding]:
    if operator.body.enabling != "none":
        return []
    what = "no enabling switch: the device pushes whether or not a hand holds it"
    step = "wire a hand switch to its digital input (enabling: switch), or hold a key (key)"
    return [Finding("warning", what, "operator.rig.device.enabling", step)]


def _walls(trial: TrialConfig, port: Port) -> list[Finding]:
    """Report the stiffest wall, and the damping that the trial's own would need."""
    where, step = "operator.rig.device.damping", "measure the device's friction, or add a brake"
    units = trial.rig.units
    stiffness, damping = f"{units.force}/{units.position}", f"{units.force} s/{units.position}"
    if port.damping <= 0.0:
        what = f"no damping at all: K_max is 0 {stiffness}, no wall can be rendered"
        return [Finding("error", what, where, step)]
    bound = PassivityBound(port)
    what = f"with {port.damping:g} {damping} K_max is {bound.stiffness_max:.0f} {stiffness}"
    findings = [Finding("ok", what, where)]
    if isinstance(trial.plant, SimulatedPlantConfig):
        body = trial.plant.environment
        needed = bound.required_damping(body.stiffness, body.damping)
        wall = f"{body.stiffness:g} {stiffness} and {body.damping:g} {damping}"
        what = f"the trial's wall of {wall} needs {needed:.2f} {damping} of damping"
        if needed <= port.damping:
            findings.append(Finding("ok", what, where))
        else:
            soft, calm = bound.reduce(body.stiffness, body.damping)
            what += f"; it is rendered as {soft:.0f} {stiffness} and {calm:.1f} {damping}"
            findings.append(Finding("warning", what, where, step + ", or lower the latency"))
    return findings
