"""Which drivers there are, and which parts, buses and ports a rig's config names."""

from __future__ import annotations

import secrets
import tempfile
from typing import TYPE_CHECKING

from teleop_rt_drivers.actuators.config import (
    ActuatorDeviceConfig,
    MitCanPart,
    MoteusPart,
    OdrivePart,
    VescPart,
)
from teleop_rt_drivers.actuators.line_config import DynamixelPart, FeetechPart
from teleop_rt_drivers.actuators.part import CanActuatorPart, LineActuatorPart
from teleop_rt_drivers.bus import UNIX
from teleop_rt_drivers.bus_log import logging_processes
from teleop_rt_drivers.canopen.config import CanopenConfig, CanopenDeviceConfig, CanopenPart
from teleop_rt_drivers.foreign import foreign_drivers
from teleop_rt_drivers.framed.config import (
    RawCanConfig,
    RawCanPart,
    SerialConfig,
    SerialDeviceConfig,
    SerialPart,
)
from teleop_rt_drivers.mixed import MixedConfig
from teleop_rt_drivers.recording import RecordingAxisConfig
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig

if TYPE_CHECKING:
    from contextlib import AbstractContextManager
    from pathlib import Path

    from teleop_rt.config.rig import AxisConfig, RigConfig
    from teleop_rt.config.trial import PlantConfig

CanBusPart = CanopenPart | RawCanPart | CanActuatorPart
"""Parts that have a CAN bus of their own."""

AXIS_SCHEMAS: dict[str, type[AxisConfig]] = {
    "canopen": CanopenConfig,
    "canopen_device": CanopenDeviceConfig,
    "serial": SerialConfig,
    "serial_device": SerialDeviceConfig,
    "actuator_device": ActuatorDeviceConfig,
    "raw_can": RawCanConfig,
    "odrive": OdrivePart,
    "mit_can": MitCanPart,
    "moteus": MoteusPart,
    "vesc": VescPart,
    "dynamixel": DynamixelPart,
    "feetech": FeetechPart,
    "mixed": MixedConfig,
    "recording": RecordingAxisConfig,
}
"""The schema of the `axis` section, by its `driver`."""

FOREIGN = foreign_drivers(set(AXIS_SCHEMAS))
"""Drivers of other packages by name."""
AXIS_SCHEMAS |= {name: driver.schema for name, driver in FOREIGN.items()}

PLANT_SCHEMAS: dict[str, type[PlantConfig]] = dict.fromkeys(
    (
        "canopen",
        "serial",
        "raw_can",
        "mixed",
        "odrive",
        "mit_can",
        "moteus",
        "dynamixel",
        "feetech",
        "vesc",
    ),
    SimulatedPlantConfig,
)
"""The schema of a trial's `plant` section, by the driver whose devices can be simulated."""


def parts_of(axis: AxisConfig) -> dict[str, AxisConfig]:
    """Return the parts of a mixed axis by name; another axis is its own only part, named ""."""
    if isinstance(axis, ActuatorDeviceConfig):
        return {"": axis.drive}
    return dict(axis.parts) if isinstance(axis, MixedConfig) else {"": axis}


def own_run(rig: RigConfig) -> list[str]:
    """Return overrides that give a run of simulated devices buses and ports of its own."""
    changes = []
    for name, part in parts_of(rig.axis).items():
        path = f"rig.axis.parts.{name}" if name else "rig.axis"
        if isinstance(part, SerialPart | LineActuatorPart):
            changes.append(f"{path}.folder={tempfile.mkdtemp(prefix='teleop-rt-ports-')}")
        elif isinstance(part, CanBusPart) and part.bus.interface == UNIX:
            changes.append(f"{path}.bus.channel=run-{secrets.token_hex(4)}")
        elif isinstance(part, CanBusPart) and part.bus.interface == "udp_multicast":
            changes.append(f"{path}.bus.port={20000 + secrets.randbelow(20000)}")
    return changes


def logged(rig: RigConfig, folder: Path) -> AbstractContextManager[None]:
    """Log the rig's buses that ask for it into the folder, in processes of their own."""
    parts = parts_of(rig.axis).items()
    buses = {name: part.bus for name, part in parts if isinstance(part, CanBusPart)}
    return logging_processes(buses, folder)


def reached_by(rig: RigConfig) -> list[str]:
    """Return the buses and ports of a rig, each of which only one program may use at a time."""
    found = []
    for part in parts_of(rig.axis).values():
        if isinstance(part, SerialPart):
            found += [part.path(name) for name in part.ports]
        elif isinstance(part, LineActuatorPart):
            found.append(part.path)
        elif isinstance(part, CanBusPart):
            found.append(str(part.bus))
    return found
