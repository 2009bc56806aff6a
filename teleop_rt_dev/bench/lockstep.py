"""The slave's tick in lock-step: Python instructions and calls, work, and a trial's processor time.

Slave, ends of the link, drivers and simulated rig run in this process, so that their instructions
are counted together; they do not depend on the machine's other work.
"""

from __future__ import annotations

import operator
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any
from unittest.mock import patch

from teleop_rt.cli.wiring import load_trial_file, open_bench
from teleop_rt.slave.faults import State
from teleop_rt.slave.slave import Slave
from teleop_rt.trial.lockstep_run import LockstepTrial
from teleop_rt_dev.bench.measure import Row, row
from teleop_rt_dev.bench.rig_beside import WHOLE_BANK
from teleop_rt_dev.paths import SILICONE

RIGS = ("canopen", "serial", "mixed")
IDEAL_LINK = ("link.loss=0.0", "link.round_trip_ms=0.0", "link.jitter_ms=0.0")
WARM_UP, COUNTED, TIMED = 4000, 200, 3000
STEPS_PER_SECOND = 1000  # of the shipped rigs
TRIAL_ROW = "default trial, processor time of a simulated second"
Work = Callable[[], None]


def run(rounds: int) -> list[Row]:
    """Count and time a tick on each rig, then time whole seconds of the default trial."""
    found = []
    for rig in RIGS:
        instructions, calls, work_us = measure(rig)
        found += [
            row(f"{rig}, Python instructions of a tick", "count", instructions),
            row(f"{rig}, Python calls of a tick", "count", calls),
            row(f"{rig}, work of a tick", "us", work_us),
        ]
    seconds = processor_seconds(rounds)
    return [*found, row(TRIAL_ROW, "s", seconds, "<= 0.15")]


def measure(rig: str) -> tuple[list[int], list[int], list[float]]:
    """Return instructions, calls and work [us] of ticks in which the slave follows, 30 estimators.

    Raises RuntimeError where the slave does not follow.
    """
    settings = (*IDEAL_LINK, f"rig=../rigs/simulated_{rig}.yaml", *WHOLE_BANK)
    work_us: list[float] = []
    counted: list[tuple[int, int]] = []
    with watched() as watch, lockstep(*settings) as trial:
        steps(trial, WARM_UP)
        watch.runs = lambda cycle: work_us.append(timed(cycle))
        steps(trial, TIMED)
        watch.runs = lambda cycle: counted.append(count(cycle))
        steps(trial, COUNTED)
        if trial.slave.safety.state is not State.RUN:
            raise RuntimeError(f"{rig}: the slave does not follow: {trial.slave.safety.state.name}")
    return [one for one, _ in counted], [calls for _, calls in counted], work_us


def processor_seconds(rounds: int) -> list[float]:
    """Return the processor time [s] of each simulated second of the default trial, after one."""
    taken = []
    with lockstep() as trial:
        for _ in range(rounds + 1):
            started = time.process_time()
            steps(trial, STEPS_PER_SECOND)
            taken.append(time.process_time() - started)
    return taken[1:]


@dataclass
class Watch:
    """Runs the cycles of a slave; plainly until something else is set."""

    runs: Callable[[Work], None] = operator.call


@contextmanager
def watched() -> Iterator[Watch]:
    """Yield the function that runs the cycles of slaves whose schedule is made meanwhile."""
    watch, cycle = Watch(), Slave.cycle

    def run_watched(slave: Slave) -> None:
        watch.runs(partial(cycle, slave))

    with patch.object(Slave, "cycle", run_watched):
        yield watch


@contextmanager
def lockstep(*settings: str) -> Iterator[LockstepTrial]:
    """Yield the default trial with these settings in lock-step, its slave configured."""
    loaded = load_trial_file(SILICONE, list(settings))
    with tempfile.TemporaryDirectory() as ring_folder:
        trial = LockstepTrial(loaded, SILICONE.parent, open_bench, Path(ring_folder))
        trial.slave.configure()
        try:
            yield trial
        finally:
            trial.bench.axis.stop()
            trial.bench.axis.close()
            trial.master.let_go()


def steps(trial: LockstepTrial, number: int) -> None:
    """Run so many steps of the schedule; a rig of 1 kHz takes 1000 in a second."""
    for _ in range(number):
        trial.step()


def count(work: Work) -> tuple[int, int]:
    """Return the Python instructions and the calls of Python functions that `work` takes."""
    instructions = calls = 0

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal instructions, calls
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        instructions += event == "opcode"
        calls += event == "call"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return instructions, calls


def timed(work: Work) -> float:
    started_ns = time.perf_counter_ns()
    work()
    return (time.perf_counter_ns() - started_ns) * 1e-3
