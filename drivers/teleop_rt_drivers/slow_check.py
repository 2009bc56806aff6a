"""Checks of slow sensors: their rate, and the force that can build up between two samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.bus_load import BITS_PER_SERIAL_BYTE, FULLEST_LINE
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.framed.config import FramedPart, SerialPart
from teleop_rt_drivers.framed.format import TextFormat, load_format
from teleop_rt_drivers.registry import parts_of

if TYPE_CHECKING:
    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt_drivers.framed.signal_config import SignalConfig


def check_line_rates(part: AxisConfig, rig: RigConfig, where: str) -> list[Finding]:
    """Compare the lines that a port can carry with the rate of its device, or of the loop."""
    if not isinstance(part, SerialPart):
        return []
    findings = []
    for name, signal in part.signals.items():
        port = part.ports[signal.source]
        frame = load_format(port.format)
        if not isinstance(frame, TextFormat):
            continue
        most_hz = FULLEST_LINE * port.baud / (BITS_PER_SERIAL_BYTE * frame.longest_line)
        key, rate_hz = f"{where}.{name}.rate_hz", signal.rate_hz or rig.rate_hz
        what = f"{port.baud} baud carry {most_hz:.0f} lines/s of {frame.longest_line} characters"
        if rate_hz <= most_hz:
            findings.append(Finding("ok", f"{what}, for {rate_hz:g} values/s", key))
        elif signal.rate_hz is None:
            step = f"set {name}.rate_hz to the device's own rate: its values are then held"
            what = f"{what}; the loop needs {rate_hz:g} values/s, one for each cycle"
            findings.append(Finding("error", what, key, step))
        else:
            step = "raise the baud rate, or lower the device's rate"
            findings.append(Finding("error", f"{what}, not {rate_hz:g}", key, step))
    return findings


STAMPS_WORTH_A_STEP = 0.2
"""Deviation of the stamps, over the period, from which another adapter is worth a word."""


def check_stamps(rig: RigConfig) -> list[Finding]:
    """State the error of the time between position and force, and that of damping by it."""
    period_s = rig.period_ns * 1e-9
    deviation_s = rig.axis.stamp_deviation_s(period_s)
    if deviation_s == 0.0:
        return []
    unit = f"{rig.units.force} s/{rig.units.position}"
    what = (
        f"no SYNC latches position and force together: the time between them is uncertain by "
        f"{1e3 * deviation_s:.2g} ms, and so is the damping, by {1e3 * deviation_s:.2g} {unit} for "
        f"each 1000 {rig.units.force}/{rig.units.position} of stiffness"
    )
    where = "sensors.force_lag_deviation_ms"
    if deviation_s <= STAMPS_WORTH_A_STEP * period_s:
        return [Finding("ok", what, where)]
    step = "take a CAN adapter with a driver of the kernel (socketcan), which stamps each frame"
    return [Finding("warning", what, where, step)]


def check_overshoot(rig: RigConfig, force_cap: float | None) -> list[Finding]:
    """Compare the unseen rise of a force with the reserve between cap and limit.

    Speed of contact times largest stiffness times the age of a force: its hold time and lag.
    """
    slow = [
        (signal, f"axis.parts.{name}.force" if name else "axis.force")
        for name, part in parts_of(rig.axis).items()
        if isinstance(part, FramedPart)
        and (signal := part.force) is not None
        and signal.held_ms(rig.rate_hz) > 0.0
    ]
    return [_overshoot(signal, rig, force_cap, where) for signal, where in slow]


def _overshoot(
    signal: SignalConfig, rig: RigConfig, force_cap: float | None, where: str
) -> Finding:
    unit, limits = rig.units, rig.limits
    stiffness_key = f"limits.stiffness_max_{unit.force}_per_{unit.position}"
    held_ms, lag_ms = signal.held_ms(rig.rate_hz), max(0.0, rig.sensors.force_lag_ms)
    what = (
        f"a force is up to {held_ms + lag_ms:.3g} ms old (hold {held_ms:g} ms, lag {lag_ms:g} ms)"
    )
    if limits.stiffness_max is None:
        step = f"set {stiffness_key} to the stiffest thing that the tool meets"
        what += ", and how far it can rise meanwhile is not known"
        return Finding("error", what, stiffness_key, step)
    unseen = limits.velocity_max * limits.stiffness_max * 1e-3 * (held_ms + lag_ms)
    speed = f"{limits.velocity_max:g} {unit.position}/s"
    what += f": at {speed} it can rise by {unseen:.3g} {unit.force} unseen"
    if force_cap is None:
        step = f"keep slave.force_cap at or below {limits.force_max - unseen:.3g} {unit.force}"
        return Finding("error" if unseen >= limits.force_max else "ok", what, where, step)
    reserve = limits.force_max - force_cap
    what += (
        f"; limits.force_max {limits.force_max:g} {unit.force} leaves {reserve:.3g} {unit.force}"
    )
    what += f" above slave.force_cap {force_cap:g} {unit.force}"
    if unseen > reserve:
        step = "lower limits.velocity_max or slave.force_cap, or take a faster sensor"
        return Finding("error", what, where, step)
    return Finding("ok", what, where)
