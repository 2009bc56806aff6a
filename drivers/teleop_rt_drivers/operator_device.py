"""How to open an operator's device, real or simulated in this process, from its rig's config."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.actuators.build import open_actuator_device
from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.config import CanopenDeviceConfig
from teleop_rt_drivers.ends import DaemonEnds, LockStepEnds
from teleop_rt_drivers.framed.axis import FramedAxis
from teleop_rt_drivers.framed.config import SerialDeviceConfig
from teleop_rt_drivers.framed.counters import FramedCounters
from teleop_rt_drivers.opening import framed_ports
from teleop_rt_drivers.transport import actuator_transport, canopen_transport, serial_transport

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.axis import Device
    from teleop_rt.config.operator import DeviceOperator
    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.ends import Ends
    from teleop_rt_drivers.simulated.hand_plant import HandPlant
    from teleop_rt_drivers.simulated.rig import Network
    from teleop_rt_drivers.transport import TransportTimes

    DeviceConfig = CanopenDeviceConfig | SerialDeviceConfig | ActuatorDeviceConfig


def open_device(
    config: DeviceOperator,
    now_ns: Callable[[], int],
    seed: int,
    made: Callable[[HandPlant], None] = lambda _: None,
) -> Device:
    """Return an operator's device, simulated in this process where the config has a hand.

    `made` gets the plant of a simulated one. Raises AxisError for a driver that takes no forces.
    """
    if config.hand is None:
        return open_device_of(config.rig, now_ns)
    device, _, plant = simulated_device(config, now_ns, seed)
    made(plant)
    return device


def open_device_of(rig: RigConfig, now_ns: Callable[[], int]) -> Device:
    """Return the operator's device of a rig. Raises AxisError for a driver that takes no forces."""
    return _open_device_on(rig, device_axis(rig), now_ns, DaemonEnds())


def device_axis(rig: RigConfig) -> DeviceConfig:
    """Return the axis section of an operator's device. Raises AxisError for another one."""
    if not isinstance(rig.axis, CanopenDeviceConfig | SerialDeviceConfig | ActuatorDeviceConfig):
        raise AxisError(
            f"operator.rig.axis: {rig.axis.driver!r} is not driven by force; name the rig of a"
            " handle (canopen_device, serial_device, or an actuator's): another package's driver"
            " moves a slave only"
        )
    return rig.axis


def device_transport(rig: RigConfig) -> TransportTimes:
    """Return how long samples and forces of an operator's device are on the way."""
    axis = device_axis(rig)
    if isinstance(axis, CanopenDeviceConfig):
        return canopen_transport(axis, rig)
    if isinstance(axis, ActuatorDeviceConfig):
        return actuator_transport(axis, rig)
    return serial_transport(axis, rig)


def simulated_device(
    config: DeviceOperator, now_ns: Callable[[], int], seed: int
) -> tuple[CanopenAxis | FramedAxis, Network, HandPlant]:
    """Return an operator's device and, in the same process, its parts and the plant they are on."""
    from teleop_rt_drivers.simulated_rig import hand_on_device  # noqa: PLC0415 - a daemon needs none

    ends = LockStepEnds()
    network, plant = hand_on_device(config, now_ns, seed, ends.devices)
    ends.answer_with(network.process)
    network.power_on()
    return _open_device_on(config.rig, device_axis(config.rig), now_ns, ends), network, plant


def _open_device_on(
    rig: RigConfig, axis: DeviceConfig, now_ns: Callable[[], int], ends: Ends
) -> CanopenAxis | FramedAxis:
    if isinstance(axis, CanopenDeviceConfig):
        return CanopenAxis(axis, rig, ends.bus("", axis.bus), now_ns)
    if isinstance(axis, ActuatorDeviceConfig):
        return open_actuator_device(axis, rig, ends.bus("", axis.bus), now_ns)
    counters = FramedCounters()
    return FramedAxis(axis, rig, framed_ports("", axis, ends, counters), now_ns, counters)
