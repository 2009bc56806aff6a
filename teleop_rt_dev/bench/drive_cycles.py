"""A cycle with a maker's drive: its answers read and decoded, the next target sent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import can

from teleop_rt.axis import Sample
from teleop_rt.config.loader import load_trial
from teleop_rt.config.trial import TrialConfig
from teleop_rt_dev.bench.measure import processor_seconds
from teleop_rt_dev.paths import TRIALS
from teleop_rt_dev.trial.files import plant_of
from teleop_rt_drivers.actuators.build import open_actuator, open_line_actuator
from teleop_rt_drivers.actuators.part import LineActuatorPart
from teleop_rt_drivers.ends import LockStepEnds
from teleop_rt_drivers.opening import open_axis_on, open_rig_on
from teleop_rt_drivers.registry import AXIS_SCHEMAS, PLANT_SCHEMAS
from teleop_rt_drivers.simulated.pipes import pipe
from teleop_rt_drivers.simulated.synchronous_bus import synchronous_pair

TRIAL = TRIALS / "silicone_cube.yaml"


@dataclass(frozen=True)
class Heard:
    """The answers of a simulated drive in a cycle: its fullest frames, or its bytes on a line."""

    trial: TrialConfig
    frames: list[can.Message]
    packet: bytes


def listened(name: str, now: list[int]) -> Heard:
    """Run a rig with a maker's drive for some cycles of 1 ms, and return the drive's answers.

    now: the simulated time [ns], which goes on.
    """
    trial = load_trial(
        TRIAL, AXIS_SCHEMAS, PLANT_SCHEMAS, [f"rig=../rigs/simulated_{name}.yaml"]
    )  # fmt: skip
    ends = LockStepEnds()
    simulated = open_rig_on(trial.rig, plant_of(trial), lambda: now[0], 1, ends.devices)
    ends.answer_with(simulated.process)
    simulated.power_on()
    whole = open_axis_on(trial.rig, lambda: now[0], ends)
    whole.configure()
    answers: list[can.Message] = []
    packets: list[bytes] = []
    wire, line = ends.bus_pair("drive")[0], ends.line_pair("drive")[1]
    deliver, write = wire.deliver, line.write

    def delivered(frame: can.Message) -> None:
        answers.append(frame)
        deliver(frame)

    def written(data: bytes) -> int:
        packets.append(data)
        return write(data)

    setattr(wire, "deliver", delivered)
    setattr(line, "write", written)
    sample = Sample()
    fullest: list[can.Message] = []
    for _ in range(12):  # an ODrive's heartbeat comes every tenth cycle
        now[0] += 1_000_000
        answers.clear()
        packets.clear()
        whole.read_into(sample)
        whole.write(0.0)
        fullest = max(fullest, list(answers), key=len)
    return Heard(trial, fullest, b"".join(packets))


def actuator_cycle(name: str) -> Callable[[int], float]:
    """Return the timed cycle of a maker's drive: its answers read, the next target sent."""
    now = [10**9]
    heard, sample = listened(name, now), Sample()
    rig: Any = heard.trial.rig
    part = rig.axis.parts["drive"]
    alone, (near, far) = synchronous_pair()[0], pipe()
    on_line = isinstance(part, LineActuatorPart)
    axis: Any
    if on_line:
        axis = open_line_actuator(part, rig, lambda: near, lambda: now[0])
    else:
        axis = open_actuator(part, rig, alone, lambda: now[0])
    axis.listen()

    def work(cycles: int) -> float:
        def one() -> None:
            for _ in range(cycles):
                now[0] += 1_000_000
                if on_line:
                    far.write(heard.packet)
                else:
                    alone._queue.extend(heard.frames)
                axis.read_into(sample)
                axis.write(0.0)
                if on_line:
                    far.read()

        spent = processor_seconds(one) / cycles
        assert sample.valid
        return spent

    return work


DRIVES = ("odrive", "damiao", "robstride", "moteus", "vesc", "dynamixel", "feetech")
