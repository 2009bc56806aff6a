"""An operator's device alone, with the hand that holds it and a clock."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.master.device import HeldDevice
from teleop_rt.master.handle_safety import HandleWatch
from teleop_rt_dev.paths import TRIALS
from teleop_rt_drivers.operator_device import simulated_device

CANOPEN = TRIALS / "handle.yaml"
SERIAL = TRIALS / "serial_handle.yaml"
MS = 1_000_000
START_NS = 10**12  # any time of a clock that is far from 0


class HandleBench:
    """The device alone, with the hand that holds it and a clock."""

    def __init__(self, trial: Path = CANOPEN, changes: Sequence[str] = ()) -> None:
        self.now = START_NS
        config: Any = load_trial_file(trial, list(changes)).operator
        self.network: Any
        self.plant: Any
        self.axis, self.network, self.plant = simulated_device(config, lambda: self.now, 1)
        rig = config.rig
        self.watch = HandleWatch(rig.limits, 1e-3, config.body.enabling, rig.axis.unsafe())
        self.operator: Any = HeldDevice(self.axis, self.watch, 1e-3, 30.0)
        self.operator.configure()

    def update(self, force: float, count: int = 1) -> tuple[float, float]:
        position = velocity = 0.0
        for _ in range(count):
            self.now += MS
            position, velocity = self.operator.update(0.0, force)
            self.operator.push(force)
        return position, velocity
