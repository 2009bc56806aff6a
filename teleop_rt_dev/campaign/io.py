"""Random and mutated bytes and frames against every driver: none may raise or change a value.

Each valid sample is held against the truth of the simulated plant at its stamp. Prints one JSON
object per driver; exits with 1 where a valid value was changed.
"""

from __future__ import annotations

import argparse
import json
import random
from typing import Any

import can
import numpy as np

from teleop_rt.axis import Sample
from teleop_rt.config.loader import load_trial
from teleop_rt.signals import TRUTH, columns
from teleop_rt_dev.paths import SILICONE
from teleop_rt_dev.trial.files import plant_of
from teleop_rt_drivers import opening, registry
from teleop_rt_drivers.ends import LockStepEnds

COLUMN = columns(TRUTH)
PERIOD_NS = 1_000_000  # of the shipped rigs: 1 kHz
PER_CYCLE = 100  # bytes or frames of garbage per line or bus, far more than the devices send
QUIET = ("force_noise_N=0", "force_lag_jitter_us=0", "force_lag_ms=0")
POSITION_ERROR, FORCE_ERROR = 2.6e-6, 0.6e-3
# NMT, SYNC, time, and frames of the rigs' nodes: garbage under an id that is heard.
IDS = (0x000, 0x080, 0x100, 0x101, 0x102, 0x190, 0x1A0, 0x1B0, 0x290, 0x710, 0x720, 0x730, 0x77F)


class Attack:
    """Garbage for the daemon's ends of a rig: random, or good traffic with a bit flipped."""

    def __init__(self, ends: LockStepEnds, seed: int) -> None:
        self._random = random.Random(seed)
        self._lines = [daemon for daemon, _ in ends._lines.values()]
        self._buses = [daemon for daemon, _ in ends._buses.values()]
        self.sent = 0

    def strike(self) -> None:
        """Put garbage before the frames that the devices will send in this cycle."""
        for line in self._lines:
            line._arrived += self._random.randbytes(PER_CYCLE)
            self.sent += PER_CYCLE
        for bus in self._buses:
            for _ in range(PER_CYCLE):
                bus._queue.append(self._frame())
                self.sent += 1

    def _frame(self) -> can.Message:
        chance = self._random
        return can.Message(
            arbitration_id=chance.choice(IDS) if chance.random() < 0.5 else chance.randrange(0x800),
            is_extended_id=chance.random() < 0.05,
            is_remote_frame=chance.random() < 0.05,
            data=chance.randbytes(chance.randrange(9)),
        )


def campaign(kind: str, count: int, seed: int) -> dict[str, object]:
    """Attack one rig with at least `count` bytes or frames."""
    overrides = [f"rig=../rigs/simulated_{kind}.yaml", *(f"plant.sensors.{q}" for q in QUIET)]
    trial = load_trial(SILICONE, registry.AXIS_SCHEMAS, registry.PLANT_SCHEMAS, overrides)
    now = [10**12]
    ends = LockStepEnds()
    rig = opening.open_rig_on(trial.rig, plant_of(trial), lambda: now[0], seed, ends.devices)
    ends.answer_with(rig.process)
    rig.power_on()
    axis: Any = opening.open_axis_on(trial.rig, lambda: now[0], ends)
    axis.configure()
    axis.arm()
    attack, sample = Attack(ends, seed), Sample()
    truths: dict[int, list[float]] = {}
    valid = changed = cycles = 0
    while attack.sent < count:
        now[0] += PERIOD_NS
        attack.strike()
        axis.read_into(sample)
        axis.write(0.011 * (1 - np.cos(2 * np.pi * 3e-3 * cycles)))
        cycles += 1
        truths[int(rig.truth_row[COLUMN["stamp_ns"]])] = rig.truth_row
        truths.pop(now[0] - 20 * PERIOD_NS, None)
        if sample.valid and cycles > 3:
            valid += 1
            position = truths[sample.position_stamp_ns][COLUMN["position"]]
            # A CANopen force is that of its SYNC, like the position.
            force = truths[sample.force_stamp_ns][COLUMN["force"]]
            good = abs(sample.position - position) < POSITION_ERROR
            changed += not (good and abs(sample.force - force) < FORCE_ERROR)
    counted = {name: number for name, number in axis.counters.items() if number}
    return {
        "driver": kind, "sent": attack.sent, "cycles": cycles, "valid": valid, "changed": changed,
        "fault": sample.fault.name, "counted": counted,
    }  # fmt: skip


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev campaign io", description=__doc__)
    parser.add_argument("--count", type=int, default=1_000_000, help="bytes or frames per driver")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--drivers", nargs="*", default=["canopen", "serial", "raw_can", "mixed"])
    chosen = parser.parse_args(arguments)
    harmed = 0
    for kind in chosen.drivers:
        result = campaign(kind, chosen.count, chosen.seed)
        harmed += int(str(result["changed"]))
        print(json.dumps(result), flush=True)
    return 1 if harmed else 0
