"""The cost of a cycle to the simulated rig: processor time of its process, answering at 1 kHz."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from teleop_rt.axis import Sample
from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.bench.rig_beside import LOOP_CPU, rig_alone

RIGS = ("canopen", "serial", "mixed")
CYCLES, WARM_UP = 4000, 1000
PERIOD_NS = 1_000_000  # of the shipped rigs: 1 kHz
LEAST_ANSWERED = 0.5  # of the cycles: with fewer the machine was too busy to measure on
BAR = "<= 60"


def run(rounds: int) -> list[Row]:
    """Measure each rig in a process of its own; a third of the rounds suffices."""
    take_all_cores()
    return [
        row(
            f"simulated {rig} rig, processor time of a cycle's answer",
            "us",
            [_measured(rig) for _ in range(max(1, rounds // 5))],
            BAR,
        )
        for rig in RIGS
    ]


def _measured(rig: str) -> float:
    itself = [sys.executable, "-m", __name__, rig]
    done = subprocess.run(itself, stdout=subprocess.PIPE, text=True, check=True)
    found: float = json.loads(done.stdout)
    return found


def processor_ns(process: int) -> int:
    """Return how long a process has run so far [ns], as the scheduler counts it."""
    return int(Path(f"/proc/{process}/schedstat").read_text(encoding="ascii").split()[0])


def measure(rig: str) -> float:
    """Return the processor time [us] of a cycle: it is asked, and commanded where it stands.

    Only answered cycles count: on a busy machine some answers come after their cycle.
    """
    with rig_alone(rig) as (axis, process):
        sample = Sample()
        prepare_process(60, LOOP_CPU)
        clock = RealClock(PERIOD_NS)
        began_ns = answered = 0
        for cycle in range(WARM_UP + CYCLES):
            clock.wait_next_tick()
            axis.read_into(sample)
            axis.write(sample.position)
            if cycle == WARM_UP:
                began_ns, answered = processor_ns(process), 0
            answered += sample.valid
        if answered < LEAST_ANSWERED * CYCLES:
            raise RuntimeError(f"{rig}: the rig answered {answered} of {CYCLES} cycles")
        return (processor_ns(process) - began_ns) * 1e-3 / answered


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1])))
