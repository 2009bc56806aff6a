"""Build the axis of a drive with a protocol of its maker."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt_drivers.actuators.asking import AskingPort
from teleop_rt_drivers.actuators.drive import ActuatorDrive, ActuatorForceDrive
from teleop_rt_drivers.actuators.port import ActuatorPort
from teleop_rt_drivers.actuators.wire import CanWire, LineWire
from teleop_rt_drivers.bus_load import line_turn_s
from teleop_rt_drivers.drivetrain import Drivetrain
from teleop_rt_drivers.framed.axis import FramedAxis
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.quantity import Scale
from teleop_rt_drivers.transport import actuator_transport, timing_of

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.actuators.codec import Codec, TorqueCodec
    from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
    from teleop_rt_drivers.actuators.part import ActuatorPart, CanActuatorPart, LineActuatorPart
    from teleop_rt_drivers.actuators.wire import Wire
    from teleop_rt_drivers.framed.stream import ByteStream

    NowNs = Callable[[], int]


def open_actuator(
    part: CanActuatorPart, rig: RigConfig, bus: can.BusABC, now_ns: NowNs
) -> FramedAxis:
    """Return the axis of such a drive, on a bus that it closes. Raises AxisError."""
    counters = FramedCounters()
    return _axis(part, rig, part.codec(rig), CanWire(bus, counters), counters, now_ns)


def open_line_actuator(
    part: LineActuatorPart,
    rig: RigConfig,
    open_stream: Callable[[], ByteStream],
    now_ns: NowNs,
) -> FramedAxis:
    """Return the axis of such a drive on a serial line that it opens and closes."""
    counters, codec = FramedCounters(), part.codec(rig)
    wire = LineWire(codec, open_stream, counters, round(1e9 * line_turn_s(part, rig)))
    return _axis(part, rig, codec, wire, counters, now_ns)


def _axis(
    part: ActuatorPart,
    rig: RigConfig,
    codec: Codec,
    wire: Wire,
    counters: FramedCounters,
    now_ns: NowNs,
) -> FramedAxis:
    port = _port(part, codec, wire, counters, now_ns)
    scale = Scale(part.scale, part.sign, part.offset)
    drive = ActuatorDrive(part, port, (scale, scale), counters)
    axis = FramedAxis(part.framed(), rig, {"drive": port}, now_ns, counters, drive)
    if part.drivetrain is not None:
        axis.drivetrain = Drivetrain(part.drivetrain, rig.limits.velocity_max, rig.period_ns)
    return axis


def open_actuator_device(
    config: ActuatorDeviceConfig, rig: RigConfig, bus: can.BusABC, now_ns: NowNs
) -> FramedAxis:
    """Return an operator's device that is such a drive, on a bus that it closes."""
    part, counters = config.drive, FramedCounters()
    wire = CanWire(bus, counters)
    if (asked := config.asked) is None:
        codec = part.codec(rig)
        port = _port(part, codec, wire, counters, now_ns, codec)
    else:
        answer_ns = round(1e6 * (config.answer_within_ms or 0.0))
        times = (*_watched_ns(part), answer_ns)
        port = AskingPort(asked.codec(rig), wire, counters, now_ns, *times)
    scale = Scale(part.force_per_torque, part.sign, 0.0)
    drive = ActuatorForceDrive(part, port, (scale, scale), counters)
    timing = timing_of(actuator_transport(config, rig), rig)
    ports = {"drive": port}
    return FramedAxis(part.framed(), rig, ports, now_ns, counters, drive, timing)


def _port(
    part: ActuatorPart,
    codec: Codec,
    wire: Wire,
    counters: dict[str, int],
    now_ns: NowNs,
    by_torque: TorqueCodec | None = None,
) -> ActuatorPort:
    return ActuatorPort(codec, wire, counters, now_ns, *_watched_ns(part), by_torque)


def _watched_ns(part: ActuatorPart) -> tuple[int, int | None]:
    """Return how old a state may be, and how long the drive goes on without commands."""
    watchdog_ns = None if part.watchdog_ms is None else part.watchdog_ms * 1_000_000
    return part.state_timeout_ms * 1_000_000, watchdog_ns
