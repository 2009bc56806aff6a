"""The whole tick on the machine's clock: buses in and out, link, whole bank, safety, rings."""

from __future__ import annotations

import json
import subprocess
import sys

import numpy as np
from bench_measure import Row, row, take_all_cores
from rig_beside import LOOP_CPU, WHOLE_BANK, slave_on

from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.slave.faults import State

BARS = {1000: 0.25, 4000: 0.6}
RIGS = ("canopen", "serial", "mixed")
TICKS = 4000


def run(rounds: int) -> list[Row]:
    """Measure each rig at each rate, in a process of its own; a third of the rounds suffices."""
    take_all_cores()
    found = []
    for rig in RIGS:
        for rate_hz, bar in BARS.items():
            times = [_measure(rig, rate_hz) for _ in range(max(1, rounds // 5))]
            for name, index in (("p50", 0), ("p99", 1)):
                found.append(
                    row(f"{rig}, {rate_hz} Hz, work {name}", "us", [t[index] for t in times])
                )
            shares = [t[1] * 1e-6 * rate_hz for t in times]
            found.append(row(f"{rig}, {rate_hz} Hz, p99 of period", "x", shares, f"<= {bar}"))
    return found


def _measure(rig: str, rate_hz: int) -> list[float]:
    done = subprocess.run(
        [sys.executable, __file__, rig, str(rate_hz)], capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(done.stderr)
    return json.loads(done.stdout)


def measure(rig: str, rate_hz: int) -> list[float]:
    """Return p50 and p99 of the work of a tick [us], armed and led by a master."""
    with slave_on(rig, rate_hz, *WHOLE_BANK) as slave:
        prepare_process(60, LOOP_CPU)
        clock = RealClock(10**9 // rate_hz)
        work = np.full(TICKS, np.nan)
        for tick in range(-1000, TICKS):
            # As if never late: what is measured is the work, also where it does not fit.
            clock.wait_next_tick()
            slave.cycle(0, clock.wake_latency_ns)
            if slave.safety.state is State.DISARMED:
                slave.arm()
            if tick >= 0:
                work[tick] = slave.work_us
        if not slave.safety.powered:
            raise RuntimeError(f"the slave stopped: {slave.safety.fault.cause}")
    return [float(value) for value in np.quantile(work, (0.5, 0.99))]


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], int(sys.argv[2]))))
