"""Wake latency of the loop against cyclictest on the same core: before and after, in each round."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import time

import numpy as np

from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt_dev.bench.measure import Row, row

PRIORITY = 60  # realtime.priority of the shipped rigs
SECONDS = 1.0  # of one loop, ours or cyclictest's
P50_BAR, P99_BAR = "<= 1.3", "<= 1.5"
SPIN_US = 50
"""Waited without sleep before each deadline where a rig's `realtime.spin_us` says so."""


def latencies(rate_hz: int, spin_us: int) -> list[float]:
    """Run the loop's clock for a second; return its wake latencies [us] and share awake [%]."""
    clock = RealClock(10**9 // rate_hz, spin_us * 1000)
    found = np.zeros(round(rate_hz * SECONDS))
    awake_ns = 0
    for tick in range(found.size):
        clock.wait_next_tick()
        found[tick] = clock.wake_latency_ns * 1e-3
        awake_ns += clock.awake_ns
    return [*map(float, np.quantile(found, (0.5, 0.99))), awake_ns * 1e-7 / SECONDS]


def ours(rate_hz: int, spin_us: int) -> list[float]:
    """Measure in a process of its own, as FIFO sticks to a process."""
    words = [sys.executable, "-m", __name__, str(rate_hz), str(spin_us)]
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    found: list[float] = json.loads(done.stdout)
    return found


def cyclictest(rate_hz: int) -> list[float]:
    """Return p50 and p99 [us] of cyclictest's histogram."""
    interval_us = 10**6 // rate_hz
    loops = round(rate_hz * SECONDS)
    words = ["-q", "-t1", "-m", f"-p{PRIORITY}", f"-i{interval_us}", f"-l{loops}", "-h5000"]
    done = subprocess.run(["cyclictest", *words], capture_output=True, text=True, check=True)
    counts = np.zeros(5000)
    for value, count in re.findall(r"^(\d{6}) (\d{6})$", done.stdout, re.MULTILINE):
        counts[int(value)] = int(count)
    below = np.cumsum(counts) / counts.sum()
    return [float(np.searchsorted(below, share)) for share in (0.5, 0.99)]


def refusal() -> str:
    """Say why there is nothing to compare; empty where there is."""
    if shutil.which("cyclictest") is None:
        return "skipped: cyclictest is not installed (apt install rt-tests)"
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    except OSError as error:
        return f"skipped: SCHED_FIFO is not allowed here ({error.strerror})"
    return ""


def run(rounds: int) -> list[Row]:
    """Interleave both; a ratio of each round, its reference the mean of before and after."""
    if why := refusal():
        return [row(why, "", [])]
    found = []
    for rate_hz in (1000, 2000, 4000):
        for spin_us in (0, SPIN_US):
            spun = f", {spin_us} us spun" if spin_us else ""
            both = interleaved(rate_hz, spin_us, rounds)
            for index, (name, bar) in enumerate((("p50", P50_BAR), ("p99 of a second", P99_BAR))):
                label = f"{rate_hz} Hz{spun}, wake latency, {name}"
                found.append(row(f"{label}: ours", "us", [m[index] for m, _ in both]))
                found.append(row(f"{label}: cyclictest", "us", [r[index] for _, r in both]))
                found.append(row(label, "x", [m[index] / r[index] for m, r in both], bar))
            awake = f"{rate_hz} Hz{spun}, waited awake, of a core"
            found.append(row(awake, "%", [m[2] for m, _ in both]))
    return found


def interleaved(rate_hz: int, spin_us: int, rounds: int) -> list[tuple[list[float], list[float]]]:
    """Return ours and the mean of cyclictest before and after it, of each round."""
    both = []
    before = cyclictest(rate_hz)
    for _ in range(rounds):
        measured, after = ours(rate_hz, spin_us), cyclictest(rate_hz)
        reference = [(one + other) / 2 for one, other in zip(before, after, strict=True)]
        both.append((measured, reference))
        before = after
    return both


if __name__ == "__main__":
    prepare_process(PRIORITY)
    time.sleep(0.05)
    print(json.dumps(latencies(int(sys.argv[1]), int(sys.argv[2]))))
