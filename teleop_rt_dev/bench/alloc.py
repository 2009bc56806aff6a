"""A minute of loop: the memory that Python holds must not grow, and no collection may run."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import tempfile
import tracemalloc
from pathlib import Path

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.bench.measure import Row, row
from teleop_rt_dev.paths import SILICONE

TICKS, TRACED_TICKS, WARM_UP = 60_000, 10_000, 5_000


def run(rounds: int) -> list[Row]:
    """Step the slave's cycle a minute long on simulated time, in contact, in its own process."""
    itself = [sys.executable, "-m", __name__]
    done = subprocess.run(itself, capture_output=True, text=True, check=True)
    grown, collections, resident = json.loads(done.stdout)
    return [
        row("left of ten seconds of ticks, all parts", "bytes", [grown], "<= 4096"),
        row("collections in a minute", "count", [collections], "<= 0"),
        row("resident memory, growth in a minute", "KiB", [resident], "<= 1024"),
    ]


def resident_kib() -> int:
    text = Path("/proc/self/statm").read_text()
    return int(text.split()[1]) * 4


def measure() -> list[float]:
    """Return net bytes, collections, and growth of resident memory [KiB] of slave and devices."""
    with tempfile.TemporaryDirectory() as ring_folder:
        world = LockstepTrial(
            load_trial_file(SILICONE, []), SILICONE.parent, open_bench, Path(ring_folder)
        )
        world.slave.configure()
        while world.slave.contact.contact_id < 2:
            world.step()
        prepare_process(1)
        for _ in range(WARM_UP):
            world.step()
        collections = sum(one["collections"] for one in gc.get_stats())
        resident = resident_kib()
        for _ in range(TICKS):
            world.step()
        resident = resident_kib() - resident
        collections = sum(one["collections"] for one in gc.get_stats()) - collections
        return [traced_growth(world), collections, resident]


def traced_growth(world: LockstepTrial) -> int:
    """Return the memory left by ten seconds of ticks [bytes], Python's own free lists apart."""
    tracemalloc.start()
    for _ in range(WARM_UP):
        world.step()
    gc.collect()
    before = tracemalloc.get_traced_memory()[0]
    for _ in range(TRACED_TICKS):
        world.step()
    gc.collect()
    return tracemalloc.get_traced_memory()[0] - before


if __name__ == "__main__":
    print(json.dumps(measure()))
