"""Which drivers there are, and how to open an axis or a simulated rig from a rig's config."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.bus import open_bus
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.config import CanopenConfig
from teleop_rt_drivers.recording import RecordingAxis, RecordingConfig
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
from teleop_rt_drivers.simulated.rig import SimulatedRig
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt.axis import Axis
    from teleop_rt.config import AxisConfig, PlantConfig, RigConfig

AXIS_SCHEMAS: dict[str, type[AxisConfig]] = {
    "canopen": CanopenConfig,
    "recording": RecordingConfig,
}
"""The schema of the `axis` section, by its `driver`."""

PLANT_SCHEMAS: dict[str, type[PlantConfig]] = {"canopen": SimulatedPlantConfig}
"""The schema of a trial's `plant` section, by the driver whose devices can be simulated."""


def plant_schema(driver: str) -> type[PlantConfig] | None:
    """Return the schema of the plant that can be simulated for a driver, or None."""
    return PLANT_SCHEMAS.get(driver)


def open_axis(rig: RigConfig, now_ns: Callable[[], int], *, bus: can.BusABC | None = None) -> Axis:
    """Return the rig's axis, on `bus` or on the bus that its config names.

    Raises AxisError when the bus cannot be opened or an EDS does not fit the config. The axis
    owns the bus from then on; `configure` finds the devices.
    """
    axis = rig.axis
    if isinstance(axis, CanopenConfig):
        return CanopenAxis(axis, rig, bus or open_bus(axis.bus), now_ns)
    if isinstance(axis, RecordingConfig):
        return RecordingAxis(axis, rig, now_ns)
    raise AxisError(f"no driver {axis.driver!r}; one of: {', '.join(sorted(AXIS_SCHEMAS))}")


def open_rig(
    rig: RigConfig,
    plant: PlantConfig,
    now_ns: Callable[[], int],
    seed: int,
    *,
    bus: can.BusABC | None = None,
) -> SimulatedRig:
    """Return the simulated devices of a rig, on `bus` or on the bus that its config names.

    Raises AxisError when the rig's driver has no simulated devices.
    """
    if not isinstance(rig.axis, CanopenConfig) or not isinstance(plant, SimulatedPlantConfig):
        raise AxisError(f"the driver {rig.axis.driver!r} has no simulated devices")
    return SimulatedRig(plant, rig, rig.axis, bus or open_bus(rig.axis.bus), now_ns, seed)


def open_lock_step(
    rig: RigConfig, plant: PlantConfig, now_ns: Callable[[], int], seed: int
) -> tuple[Axis, SimulatedRig]:
    """Return axis and simulated rig in one process: sending is delivering, stamps are `now_ns`.

    The devices are switched on; `configure` of the axis is the caller's.
    """
    daemon_end, device_end = synchronous_pair()
    simulated = open_rig(rig, plant, now_ns, seed, bus=device_end)
    device_end.on_arrival = simulated.process
    simulated.power_on()
    return open_axis(rig, now_ns, bus=daemon_end), simulated
