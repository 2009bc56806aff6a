"""Checks that a stalled loop stops the axis before the drive's own watchdog does."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.realtime.lateness import ON_HARDWARE
from teleop_rt_drivers.actuators.part import ActuatorPart
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.canopen.config import CanopenPart
from teleop_rt_drivers.canopen.entries import address
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.framed.config import FramedPart

if TYPE_CHECKING:
    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt_drivers.canopen.drive_config import DriveConfig

ABORT_CONNECTION = (0x6007, 0)  # abort connection option code (CiA 402)
STOP = "realtime.late.stop_ms"


def check_stalls(part: AxisConfig, rig: RigConfig, where: str) -> list[Finding]:
    """Compare the stall that stops the axis with the silence after which its drive stops."""
    stop_ms = rig.realtime.late.stop_ms
    if isinstance(part, CanopenPart) and part.drive is not None:
        silence_ms = part.daemon.heartbeat_ms
        key, name = f"{where}.drive.daemon_timeout_ms", "drive.daemon_timeout_ms"
        if _does_nothing(part.drive):
            what = "6007h is 0: the drive executes its last command for as long as the loop stalls"
            step = 'set it in drive.setup, "0x6007": 3 is a quick stop'
            return [Finding("error", what, f"{where}.drive.setup", step)]
        return [_compared(stop_ms, silence_ms, part.drive.daemon_timeout_ms, name, key)]
    if isinstance(part, ActuatorPart) and part.watchdog_ms is not None:
        key, name = f"{where}.watchdog_ms", "watchdog_ms"
        return [_compared(stop_ms, 0, part.watchdog_ms, name, key)]
    if isinstance(part, FramedPart) and part.drive is not None:
        key, name = f"{where}.drive.watchdog_ms", "drive.watchdog_ms"
        if part.drive.watchdog_ms is None:
            what = f"the drive's own watchdog is not known: {STOP} {stop_ms:g} alone stops the axis"
            step = "state the value of the drive's manual; without one, wire an emergency stop"
            return [Finding("warning", what, key, step)]
        return [_compared(stop_ms, 0, part.drive.watchdog_ms, name, key)]
    return []


def check_hardware_stalls(rig: RigConfig, where: str) -> list[Finding]:
    """Warn of bounds for a simulated rig on a real one; `where` is the rig's key."""
    late = rig.realtime.late
    wide = late.stop_ms > ON_HARDWARE.stop_ms or late.stop_share > ON_HARDWARE.stop_share
    if not wide:
        return []
    what = (
        f"stop_ms {late.stop_ms:g} or stop_share {late.stop_share:g} is above its bound for "
        f"hardware, {ON_HARDWARE.stop_ms:g} and {ON_HARDWARE.stop_share:g}"
    )
    step = "remove realtime.late, which is for simulated rigs, unless your rig can take such stalls"
    return [Finding("warning", what, f"{where}realtime.late", step)]


def _compared(stop_ms: float, silence_ms: int, watchdog_ms: int, name: str, key: str) -> Finding:
    """Judge a stall against a watchdog; before it the drive may have heard nothing already."""
    what = f"{STOP} {stop_ms:g} is above {name} {watchdog_ms}: the drive stops first, by itself"
    if stop_ms > watchdog_ms:
        return Finding("error", what, key, f"lower {STOP}, or raise {name} if the rig allows it")
    if stop_ms + silence_ms > watchdog_ms:
        what = (
            f"{STOP} {stop_ms:g} and {silence_ms} ms between two heartbeats are above "
            f"{name} {watchdog_ms}: the drive may stop first"
        )
        return Finding("warning", what, key, f"lower daemon.heartbeat_ms or {STOP}")
    what = f"a stall stops the axis after {stop_ms:g} ms, before the drive's {watchdog_ms} ms"
    return Finding("ok", what, key)


def _does_nothing(drive: DriveConfig) -> bool:
    """Return whether the drive ignores a daemon that falls silent (CiA 402, 6007h)."""
    for entry, value in drive.setup.items():
        if address(entry) == ABORT_CONNECTION:
            return value == 0
    default = eds.load(drive.eds, drive.node_id).get_variable(*ABORT_CONNECTION)
    return default is None or not default.default
