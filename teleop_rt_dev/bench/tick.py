"""The whole tick on the machine's clock: buses in and out, link, whole bank, safety, rings."""

from __future__ import annotations

import json
import subprocess
import sys
import time

import numpy as np

from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.slave.faults import State
from teleop_rt_dev.bench.measure import Row, quantiles, row, take_all_cores
from teleop_rt_dev.bench.rig_beside import LOOP_CPU, WHOLE_BANK, slave_on

BARS = {1000: 0.25, 4000: 0.6}
AIMS: dict[int, dict[str, str]] = {
    1000: {"p50": "<= 60", "p99": "<= 120"},
    4000: {"late": "<= 2", "stops": "<= 0"},
}
"""Aims beyond the bars, by rate: work [us], and ticks that come late."""
RIGS = ("canopen", "serial", "mixed")
TICKS, WARM_UP = 4000, 1000
MOST_SHARE = 10
"""After so many times the ticks that are wanted, whatever was counted by then is the figure."""


def run(rounds: int) -> list[Row]:
    """Measure each rig at each rate, in a process of its own; a third of the rounds suffices."""
    take_all_cores()
    found = []
    for rig in RIGS:
        for rate_hz, bar in BARS.items():
            name = f"{rig}, {rate_hz} Hz"
            taken = [measured(rig, rate_hz) for _ in range(max(1, rounds // 5))]
            shares = [{"share": one["p99"] * 1e-6 * rate_hz, **one} for one in taken]
            found += [
                row(
                    f"{name}, {title}",
                    unit,
                    [one[key] for one in shares],
                    limit or AIMS[rate_hz].get(key),
                )
                for title, key, unit, limit in (
                    ("work p50", "p50", "us", None),
                    ("work p99", "p99", "us", None),
                    ("work p99.99", "p99.99", "us", None),
                    ("work largest", "max", "us", None),
                    ("p99 of period", "share", "x", f"<= {bar}"),
                    ("plain Python, p50", "plain_p50", "us", None),
                    ("plain Python, p99", "plain_p99", "us", None),
                    ("ticks counted", "ticks", "count", None),
                    ("late meanwhile", "late", "of 1000", None),
                    ("stopped meanwhile", "stops", "times", None),
                )
            ]
    return found


def measured(rig: str, rate_hz: int, ticks: int = TICKS) -> dict[str, float]:
    """Return the result of `measure`, run in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, rig, str(rate_hz), str(ticks)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found


def measure(rig: str, rate_hz: int, ticks: int = TICKS) -> dict[str, float]:
    """Return quantiles of the work of a tick [us], led by a master and following it.

    Rig and master share a core, and may be late where others want it, too: a real slave would then
    stop, and so does this one. It is reset, and only ticks on which it follows count; `stops` is
    the number of resets, `late` the number of skipped ticks in a thousand. `plain_p99` is the time
    that as much work, the same in every tick, takes on this machine right after.
    """
    work: list[float] = []
    stops = late = 0
    with slave_on(rig, rate_hz, *WHOLE_BANK) as (slave, new_clock):
        prepare_process(60, LOOP_CPU)
        clock = new_clock()
        for tick in range(MOST_SHARE * ticks):
            # As if never late: the work is measured, also where it does not fit.
            skipped = clock.wait_next_tick()
            slave.cycle(0, clock.wake_latency_ns)
            state = slave.safety.state
            if state is State.DISARMED:
                slave.arm()
            elif state is State.FAULT:
                stops += 1
                print(f"{rig}, {rate_hz} Hz: {slave.safety.fault.cause}", file=sys.stderr)
                slave.reset()
            elif state is State.RUN and tick >= WARM_UP:
                work.append(slave.work_us)
                late += skipped
            if len(work) == ticks:
                break
        if not work:
            raise RuntimeError(f"{rig}, {rate_hz} Hz: the slave never followed its master")
        found = quantiles(work)
        plain = _plainly(RealClock(10**9 // rate_hz), found["p50"])
        plain_p50, plain_p99 = np.quantile(plain, (0.5, 0.99)).tolist()
    late_of_1000 = 1000.0 * late / (late + len(work))
    counts = {"ticks": len(work), "late": late_of_1000, "stops": stops}
    return {**found, **counts, "plain_p50": plain_p50, "plain_p99": plain_p99}


def _plainly(clock: RealClock, wanted_us: float) -> list[float]:
    """Return how long the same plain Python takes in each tick [us], about as long as wanted."""

    def timed(additions: int) -> float:
        started_ns, total = time.perf_counter_ns(), 0
        for number in range(additions):
            total += number & 15
        return (time.perf_counter_ns() - started_ns) * 1e-3

    tried = 2000
    additions = round(tried * wanted_us / min(timed(tried) for _ in range(20)))
    taken = []
    for _ in range(TICKS):
        clock.wait_next_tick()
        taken.append(timed(additions))
    return taken


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], *map(int, sys.argv[2:]))))
