"""Open an axis, or the simulated devices of a rig, as its config names them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.actuators.build import (
    open_actuator,
    open_actuator_device,
    open_line_actuator,
)
from teleop_rt_drivers.actuators.config import (
    ActuatorDeviceConfig,
)
from teleop_rt_drivers.actuators.part import ActuatorPart, CanActuatorPart, LineActuatorPart
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.config import CanopenDeviceConfig, CanopenPart
from teleop_rt_drivers.canopen.receiver import sent_by_daemon
from teleop_rt_drivers.ends import DaemonEnds, DeviceEnds, LockStepEnds
from teleop_rt_drivers.framed.axis import FramedAxis
from teleop_rt_drivers.framed.can_port import CanPort
from teleop_rt_drivers.framed.config import (
    RawCanPart,
    SerialDeviceConfig,
    SerialPart,
)
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.framed.dbc import load_dbc
from teleop_rt_drivers.framed.serial_port import SerialPort
from teleop_rt_drivers.in_words import ForeignAxis, in_words
from teleop_rt_drivers.mixed import MixedAxis, MixedConfig
from teleop_rt_drivers.recording import RecordingAxis, RecordingAxisConfig
from teleop_rt_drivers.registry import AXIS_SCHEMAS, FOREIGN, parts_of
from teleop_rt_drivers.replayed_bus import REPLAY, ReplayAxis, ReplayBus
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
from teleop_rt_drivers.stamped import StampedAxis

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    import can

    from teleop_rt.axis import Axis
    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt.config.trial import PlantConfig
    from teleop_rt_drivers.ends import Ends
    from teleop_rt_drivers.framed.source import FramedPort
    from teleop_rt_drivers.simulated.rig import SimulatedRig


def open_axis(rig: RigConfig, now_ns: Callable[[], int], *, bus: can.BusABC | None = None) -> Axis:
    """Return the rig's axis, on `bus` or on the buses and ports that its config names.

    Raises AxisError when a bus cannot be opened or an EDS, DBC or format does not fit the config.
    The axis owns the bus from then on; `configure` finds the devices.
    """
    if isinstance(rig.axis, CanopenDeviceConfig | SerialDeviceConfig | ActuatorDeviceConfig):
        driver = rig.axis.driver
        raise AxisError(
            f"rig.axis.driver: {driver} measures no force: name this rig in operator.rig"
        )
    ends = DaemonEnds(bus)
    try:
        return open_axis_on(rig, now_ns, ends)
    except BaseException:
        ends.give_up()
        raise


def open_rig(
    rig: RigConfig,
    plant: PlantConfig,
    now_ns: Callable[[], int],
    seed: int,
    *,
    bus: can.BusABC | None = None,
) -> SimulatedRig:
    """Return the simulated devices of a rig, on `bus` or on the bus that its config names.

    Serial ports become pseudo-terminals under the names of the config's devices. Raises AxisError
    when the rig's driver has no simulated devices.
    """
    return open_rig_on(rig, plant, now_ns, seed, DeviceEnds(bus))


def open_lock_step(
    rig: RigConfig,
    plant: PlantConfig,
    now_ns: Callable[[], int],
    seed: int,
    log_folder: Path | None = None,
) -> tuple[Axis, SimulatedRig]:
    """Return axis and simulated rig in one process: sending is delivering, stamps are `now_ns`.

    The devices are switched on; `configure` of the axis is the caller's. Buses that ask for it are
    logged into `log_folder`.
    """
    ends = LockStepEnds(log_folder, now_ns)
    simulated = open_rig_on(rig, plant, now_ns, seed, ends.devices)
    ends.answer_with(simulated.process)
    simulated.power_on()
    return open_axis_on(rig, now_ns, ends), simulated


def open_axis_on(rig: RigConfig, now_ns: Callable[[], int], ends: Ends) -> Axis:
    """Return the rig's axis on ends of one's own choice. Raises AxisError."""
    axis = rig.axis
    _check_homing(rig)
    if isinstance(axis, ActuatorPart) and (axis.position is None or axis.force is None):
        raise AxisError(
            f"axis: a {axis.driver} alone needs `position: from drive` and `force: from drive`; "
            "with sensors of its own the rig is `mixed`, and the drive one of its parts"
        )
    if not isinstance(axis, MixedConfig):
        return _open_part("", axis, rig, now_ns, ends)
    parts = {name: _open_part(name, part, rig, now_ns, ends) for name, part in axis.parts.items()}
    return MixedAxis(axis, parts)


def _check_homing(rig: RigConfig) -> None:
    """Refuse a rig that cannot be homed as it says. Raises AxisError."""
    homing = rig.reference.homing
    if homing is None:
        return
    for name, part in parts_of(rig.axis).items():
        key = f"axis.parts.{name}.drive.zero" if name else "axis.drive.zero"
        drive = getattr(part, "drive", None)
        if drive is not None and drive.zero != "unknown":
            raise AxisError(f"{key}: write unknown, because reference.homing finds the zero")
    if homing.to == "switch" and not any(_has_switch(part) for part in parts_of(rig.axis).values()):
        raise AxisError("reference.homing.to: no part of the axis has a switch: describe it")


def _has_switch(part: AxisConfig) -> bool:
    owner = part.drive if isinstance(part, CanopenPart) else part
    return getattr(owner, "switch", None) is not None


def _open_actuator(
    name: str,
    axis: ActuatorDeviceConfig | ActuatorPart,
    rig: RigConfig,
    now_ns: Callable[[], int],
    ends: Ends,
) -> FramedAxis:
    if isinstance(axis, ActuatorDeviceConfig):
        return open_actuator_device(axis, rig, ends.bus(name, axis.bus), now_ns)
    if isinstance(axis, CanActuatorPart):
        return open_actuator(axis, rig, ends.bus(name, axis.bus), now_ns)
    assert isinstance(axis, LineActuatorPart)  # noqa: S101 - there is no third wire
    open_stream = partial(ends.line, name, axis.path, axis.baud)
    return open_line_actuator(axis, rig, open_stream, now_ns)


def _open_part(
    name: str, axis: AxisConfig, rig: RigConfig, now_ns: Callable[[], int], ends: Ends
) -> Axis:
    if isinstance(axis, CanopenPart | RawCanPart) and axis.bus.interface == REPLAY:
        return _open_replay(axis, rig, now_ns)
    if isinstance(axis, CanopenPart):
        return CanopenAxis(axis, rig, ends.bus(name, axis.bus), now_ns)
    if isinstance(axis, SerialPart | RawCanPart):
        counters = FramedCounters()
        ports = framed_ports(name, axis, ends, counters)
        return FramedAxis(axis, rig, ports, now_ns, counters)
    if isinstance(axis, ActuatorDeviceConfig | ActuatorPart):
        return _open_actuator(name, axis, rig, now_ns, ends)
    if isinstance(axis, RecordingAxisConfig):
        return RecordingAxis(axis, rig, now_ns)
    return _open_foreign(axis, rig, now_ns)


def _open_foreign(axis: AxisConfig, rig: RigConfig, now_ns: Callable[[], int]) -> Axis:
    """Return the axis of another package's driver. Raises AxisError."""
    driver = axis.driver
    if (foreign := FOREIGN.get(driver)) is None:
        raise AxisError(f"no driver {driver!r}; one of: {', '.join(sorted(AXIS_SCHEMAS))}")
    with in_words(driver, "open_axis"):
        opened = foreign.open_axis(axis, rig, now_ns)
    if not axis.executes:  # its stamps are the recording's
        return ForeignAxis(opened, driver)
    return StampedAxis(opened, driver, now_ns, rig.sample_period_ns)


def _open_replay(axis: CanopenPart | RawCanPart, rig: RigConfig, now_ns: Callable[[], int]) -> Axis:
    """Return the axis that decodes a logged bus."""
    file = axis.bus.channel or ""
    if isinstance(axis, CanopenPart):
        ours = sent_by_daemon(axis)
        bus = ReplayBus(file, lambda cob_id: cob_id == axis.daemon.sync_cob_id, ours)
        return ReplayAxis(CanopenAxis(axis, rig, bus, bus.now_ns), bus, now_ns)
    if axis.drive is None:
        raise AxisError("a bus log needs a command that marks its cycles: add axis.drive.command")
    command = load_dbc(axis.dbc)[axis.drive.command].frame_id
    bus = ReplayBus(file, lambda can_id: can_id == command, lambda _: False)
    counters = FramedCounters()
    port = CanPort(axis, bus, counters)
    return ReplayAxis(FramedAxis(axis, rig, {"": port}, bus.now_ns, counters), bus, now_ns)


def framed_ports(
    name: str, axis: SerialPart | RawCanPart, ends: Ends, counters: dict[str, int]
) -> Mapping[str, FramedPort]:
    """Return the ports of framed devices on ends of one's own choice, by name."""
    if isinstance(axis, RawCanPart):
        return {"": CanPort(axis, ends.bus(name, axis.bus), counters)}
    return {
        port: SerialPort(
            port,
            config,
            partial(ends.line, f"{name}.{port}", axis.path(port), config.baud),
            counters,
        )
        for port, config in axis.ports.items()
    }


def open_rig_on(
    rig: RigConfig, plant: PlantConfig, now_ns: Callable[[], int], seed: int, ends: Ends
) -> SimulatedRig:
    """Return the simulated devices of a rig on ends of one's own choice. Raises AxisError."""
    if not isinstance(plant, SimulatedPlantConfig):
        raise AxisError(
            f"the driver {rig.axis.driver!r} has no simulated devices"
            ": run it on its devices, or --set plant=null"
        )
    from teleop_rt_drivers.simulated_rig import simulated_rig  # noqa: PLC0415 - a daemon needs none

    return simulated_rig(rig, plant, now_ns, seed, ends)
