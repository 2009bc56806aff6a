"""A tick on CANopen over ten minutes, idle and beside work: more than a few thousand ticks show.

TELEOP_RT_MINUTES asks for another time.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.bench.tick import measured

RIG, RATE_HZ = "canopen", 1000
MINUTES = float(os.environ.get("TELEOP_RT_MINUTES", "10"))


def run(_rounds: int) -> list[Row]:
    """Measure once each: the ticks are as many as there are milliseconds."""
    take_all_cores()
    ticks, found = round(MINUTES * 60.0 * RATE_HZ), []
    for title, beside in (("idle", 0), ("beside a busy process on each core", os.cpu_count() or 1)):
        with _busy(beside):
            one = measured(RIG, RATE_HZ, ticks)
        name = f"{RIG}, {RATE_HZ} Hz, {MINUTES:g} min {title}"
        found += [
            row(f"{name}, work {key}", "us", [one[key]], limit)
            for key, limit in (("p50", "<= 60"), ("p99", "<= 120"), ("p99.99", None), ("max", None))
        ]
        found += [
            row(f"{name}, ticks counted", "count", [one["ticks"]]),
            row(f"{name}, late meanwhile", "of 1000", [one["late"]]),
            row(f"{name}, stopped meanwhile", "times", [one["stops"]], "<= 0"),
        ]
    return found


@contextmanager
def _busy(count: int) -> Iterator[None]:
    """Let so many processes count meanwhile, with the priority of any program."""
    words = [sys.executable, "-c", "while True: pass"]
    processes = [subprocess.Popen(words) for _ in range(count)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()
