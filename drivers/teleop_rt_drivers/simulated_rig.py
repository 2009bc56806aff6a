"""The simulated devices of a rig, or of an operator, on ends of one's own choice.

Who opens real devices alone does not load them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.actuators.config import ActuatorDeviceConfig
from teleop_rt_drivers.actuators.part import CanActuatorPart, LineActuatorPart
from teleop_rt_drivers.canopen.config import CanopenDeviceConfig, CanopenPart
from teleop_rt_drivers.framed.config import RawCanPart, SerialPart
from teleop_rt_drivers.operator_device import device_axis, device_transport
from teleop_rt_drivers.registry import parts_of
from teleop_rt_drivers.replayed_bus import REPLAY
from teleop_rt_drivers.simulated.actuator_network import CanActuatorNetwork
from teleop_rt_drivers.simulated.can_network import CanNetwork
from teleop_rt_drivers.simulated.canopen_network import CanopenNetwork
from teleop_rt_drivers.simulated.hand_plant import HandPlant
from teleop_rt_drivers.simulated.line_actuators import LineActuatorNetwork
from teleop_rt_drivers.simulated.rig import SimulatedRig
from teleop_rt_drivers.simulated.serial_network import SerialNetwork

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config.operator import DeviceOperator
    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt_drivers.ends import Ends
    from teleop_rt_drivers.framed.stream import ByteStream
    from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
    from teleop_rt_drivers.simulated.rig import AnsweringNetwork, Network


def simulated_rig(
    rig: RigConfig, plant: SimulatedPlantConfig, now_ns: Callable[[], int], seed: int, ends: Ends
) -> SimulatedRig:
    """Return the simulated devices of a rig. Raises AxisError for a part that has none."""
    simulated = SimulatedRig(plant, rig, now_ns, seed)
    for number, (name, part) in enumerate(parts_of(rig.axis).items()):
        network = _network(name, part, rig, simulated, now_ns, seed + 1000 * number, ends)
        simulated.networks.append(network)
    _let_answer(simulated)
    return simulated


def _let_answer(simulated: SimulatedRig) -> None:
    """Let kernels answer for the networks that one knows, on a bus and on lines together."""
    buses = [one for one in simulated.networks if isinstance(one, CanopenNetwork)]
    lines = [one for one in simulated.networks if isinstance(one, SerialNetwork)]
    if buses and lines:
        buses[0].send_beside(lines[0])
    answering: list[AnsweringNetwork] = [*buses, *(one for one in lines if one.drive is not None)]
    simulated.answering = answering[0] if answering else None


def _network(
    name: str,
    part: AxisConfig,
    rig: RigConfig,
    simulated: SimulatedRig,
    now_ns: Callable[[], int],
    seed: int,
    ends: Ends,
) -> Network:
    plant, latched = simulated.plant, simulated.note_truth
    if isinstance(part, CanopenPart | RawCanPart) and part.bus.interface == REPLAY:
        raise AxisError("a replayed bus has no devices to simulate: add --set plant=null")
    if isinstance(part, CanActuatorPart):
        bus = ends.bus(name, part.bus)
        return CanActuatorNetwork(part, plant, bus, now_ns, rig.period_ns, seed, latched)
    if isinstance(part, LineActuatorPart):
        line = ends.line(name, part.path, part.baud)
        return LineActuatorNetwork(part, plant, line, now_ns, rig.period_ns, seed, latched)
    if isinstance(part, CanopenPart):
        bus = ends.bus(name, part.bus)
        return CanopenNetwork(part, plant, bus, now_ns, seed, latched, simulated.note_rows)
    if isinstance(part, RawCanPart):
        bus = ends.bus(name, part.bus)
        return CanNetwork(part, plant, bus, now_ns, rig.period_ns, seed, latched)
    if isinstance(part, SerialPart):
        lines = lines_of(name, part, ends)
        note = simulated.note_rows
        return SerialNetwork(part, plant, lines, now_ns, rig.period_ns, seed, latched, note)
    raise AxisError(
        f"the driver {part.driver!r} has no simulated devices"
        ": run it on its devices, or --set plant=null"
    )


def lines_of(name: str, part: SerialPart, ends: Ends) -> dict[str, ByteStream]:
    """Return the lines to simulated serial devices, by the names of their ports."""
    return {
        port: ends.line(f"{name}.{port}", part.path(port), config.baud)
        for port, config in part.ports.items()
    }


def hand_on_device(
    config: DeviceOperator, now_ns: Callable[[], int], seed: int, ends: Ends
) -> tuple[Network, HandPlant]:
    """Return the parts of an operator's device on ends of one's own choice, and their plant.

    Raises AxisError.
    """
    rig, axis = config.rig, device_axis(config.rig)
    plant = HandPlant(config, device_transport(rig), now_ns(), seed)
    if isinstance(axis, CanopenDeviceConfig):
        bus = ends.bus("", axis.bus)
        network = CanopenNetwork(axis, plant, bus, now_ns, seed, lambda: None, lambda _: None)
        return network, plant
    if isinstance(axis, ActuatorDeviceConfig):
        made = CanActuatorNetwork(
            axis.drive, plant, ends.bus("", axis.bus), now_ns, rig.period_ns, seed, lambda: None
        )
        return made, plant
    lines = lines_of("", axis, ends)
    made_on = axis, plant, lines, now_ns, rig.period_ns, seed
    return SerialNetwork(*made_on, lambda: None, lambda _: None), plant
