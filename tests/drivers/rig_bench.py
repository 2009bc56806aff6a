"""Axis and simulated rig in lock-step, with a clock that the test moves."""

from __future__ import annotations

import functools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from teleop_rt.axis import Sample
from teleop_rt.config.loader import load_rig
from teleop_rt_drivers.canopen.axis import CanopenAxis
from teleop_rt_drivers.canopen.config import CanopenConfig
from teleop_rt_drivers.opening import open_rig
from teleop_rt_drivers.registry import AXIS_SCHEMAS
from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
from teleop_rt_drivers.simulated.rig import SimulatedRig
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair

if TYPE_CHECKING:
    from teleop_rt.config.rig import RigConfig

RIG_FILE = Path(__file__).parents[2] / "config" / "rigs" / "simulated_canopen.yaml"
MS = 1_000_000
START_NS = 10**12

PLANT: dict[str, Any] = {
    "environment": {"stiffness": 3600.0, "damping": 20.0, "surface": 0.01},
    "sensors": {
        "encoder_resolution": 5e-6,
        "force_noise": 0.05,
        "force_lag_ms": 1.0,
        "force_lag_jitter_us": 50.0,
    },
    "drive": {"mass": 1.0, "force_max": 300.0, "position_resolution": 1e-6},
}


@functools.cache  # frozen
def canopen_rig() -> RigConfig:
    return load_rig(RIG_FILE, AXIS_SCHEMAS)


def plant_config(**changes: dict[str, Any]) -> SimulatedPlantConfig:
    """The silicone cube, with changes such as `sensors={"force_noise": 0.0}`."""
    sections = {name: {**section, **changes.get(name, {})} for name, section in PLANT.items()}
    rest = {name: value for name, value in changes.items() if name not in PLANT}
    return SimulatedPlantConfig.model_validate({**sections, **rest})


def changed(rig: RigConfig, **axis: dict[str, Any]) -> RigConfig:
    """The rig with other values in sections of its axis."""
    assert isinstance(rig.axis, CanopenConfig)
    parts = {
        name: getattr(rig.axis, name).model_copy(update=update) for name, update in axis.items()
    }
    return rig.model_copy(update={"axis": rig.axis.model_copy(update=parts)})


class Cycles:
    """The cycles of a bench, and its silence."""

    now: int
    sample: Sample
    simulated: SimulatedRig

    def cycle(self, position: float = 0.0) -> Sample:
        raise NotImplementedError

    def cycles(self, count: int, position: float = 0.0) -> Sample:
        for _ in range(count):
            self.cycle(position)
        return self.sample

    def silence(self, milliseconds: int) -> None:
        """The daemon does nothing; the devices go on."""
        for _ in range(milliseconds):
            self.now += MS
            self.simulated.process()


class Bench(Cycles):
    """Both ends of the bus, the axis, the rig, and a clock."""

    def __init__(self, *, plant=None, seed=1, axis_rig=None, device_rig=None) -> None:
        self.now = START_NS
        rig = axis_rig or canopen_rig()
        self.daemon_end, self.device_end = synchronous_pair()
        self.simulated = open_rig(
            device_rig or rig, plant or plant_config(), lambda: self.now, seed, bus=self.device_end
        )
        self.device_end.on_arrival = self.simulated.process
        self.simulated.power_on()
        assert isinstance(rig.axis, CanopenConfig)
        self.config = rig.axis
        self.axis = CanopenAxis(rig.axis, rig, self.daemon_end, lambda: self.now)
        self.sample = Sample()

    def cycle(self, position: float = 0.0) -> Sample:
        """One cycle of the daemon, then the clock moves on by 1 ms."""
        self.axis.read_into(self.sample)
        self.axis.write(position)
        self.now += MS
        return self.sample

    def armed(self) -> Bench:
        """Configured, armed, and enabled."""
        self.axis.configure()
        self.axis.arm()
        assert self.cycles(12).enabled
        return self


def path(k: int) -> float:
    """Down onto the cube and back, smoothly: 22 mm of travel at 3 Hz."""
    return 0.011 * (1.0 - np.cos(2 * np.pi * 3 * k * 1e-3))
