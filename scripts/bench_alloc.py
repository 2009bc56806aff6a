"""A minute of loop: the memory that Python holds must not grow, and no collection may run."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import tempfile
import tracemalloc
from pathlib import Path

from bench_measure import Row, row

from teleop_rt.cli import load_trial_file, open_bench
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.trial.lockstep_run import LockstepTrial

TRIAL = Path(__file__).resolve().parents[1] / "config" / "trials" / "silicone_cube.yaml"
TICKS = 60_000


def run(rounds: int) -> list[Row]:  # noqa: ARG001 - one minute is one minute
    """Step the slave's cycle a minute long on simulated time, in contact, in its own process."""
    done = subprocess.run([sys.executable, __file__], capture_output=True, text=True, check=True)
    grown, collections, resident = json.loads(done.stdout)
    return [
        row("allocated by the slave's cycle in a minute, net", "bytes", [grown], "<= 4096"),
        row("collections in a minute", "count", [collections], "<= 0"),
        row("resident memory, growth in a minute", "KiB", [resident], "<= 1024"),
    ]


def resident_kib() -> int:
    text = Path("/proc/self/statm").read_text()
    return int(text.split()[1]) * 4


def measure() -> list[float]:
    """Return net bytes, collections, and growth of resident memory [KiB] of the slave's cycles."""
    with tempfile.TemporaryDirectory() as session:
        world = LockstepTrial(load_trial_file(TRIAL, []), TRIAL.parent, open_bench, Path(session))
        world.slave.configure()
        while world.slave._contact.contact_id < 2:  # noqa: SLF001 - past every first time
            world.step()
        prepare_process(1)
        cycle, net = world.slave.cycle, [0]

        def watched() -> None:
            before = tracemalloc.get_traced_memory()[0]
            cycle()
            net[0] += tracemalloc.get_traced_memory()[0] - before

        world.lockstep._members[0].cycle = watched  # noqa: SLF001 - the slave's place
        collections = sum(one["collections"] for one in gc.get_stats())
        resident = resident_kib()
        tracemalloc.start()
        for _ in range(TICKS):
            world.step()
        return [
            net[0],
            sum(one["collections"] for one in gc.get_stats()) - collections,
            resident_kib() - resident,
        ]


if __name__ == "__main__":
    print(json.dumps(measure()))
