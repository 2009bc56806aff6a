"""Build the axis of a drive with a protocol of its maker."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.actuators.drive import ActuatorDrive, ActuatorForceDrive
from teleop_rt_drivers.actuators.port import ActuatorPort
from teleop_rt_drivers.framed.axis import FramedAxis
from teleop_rt_drivers.framed.counters import new_counters
from teleop_rt_drivers.quantity import Scale
from teleop_rt_drivers.transport import actuator_transport, timing_of

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt.config_rig import RigConfig
    from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
    from teleop_rt_drivers.actuators.part import ActuatorPart


def open_actuator(
    part: ActuatorPart, rig: RigConfig, bus: can.BusABC, now_ns: Callable[[], int]
) -> FramedAxis:
    """Return the axis of such a drive, on a bus that it closes. Raises AxisError."""
    counters = new_counters()
    timeout_ns = part.state_timeout_ms * 1_000_000
    port = ActuatorPort(part.codec(rig), bus, counters, now_ns, timeout_ns)
    scale = Scale(part.scale, part.sign, part.offset)
    drive = ActuatorDrive(part, port, (scale, scale), counters)
    return FramedAxis(part.framed(), rig, {"drive": port}, now_ns, counters, drive)


def open_actuator_device(
    config: ActuatorDeviceConfig, rig: RigConfig, bus: can.BusABC, now_ns: Callable[[], int]
) -> FramedAxis:
    """Return an operator's device that is such a drive, on a bus that it closes."""
    part, counters = config.drive, new_counters()
    timeout_ns = part.state_timeout_ms * 1_000_000
    port = ActuatorPort(part.codec(rig), bus, counters, now_ns, timeout_ns, by_force=True)
    scale = Scale(part.force_per_torque, part.sign, 0.0)
    drive = ActuatorForceDrive(part, port, (scale, scale), counters)
    timing = timing_of(actuator_transport(config, rig), rig)
    ports = {"drive": port}
    return FramedAxis(part.framed(), rig, ports, now_ns, counters, drive, timing)
