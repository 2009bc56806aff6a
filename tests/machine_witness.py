"""Bare loops beside a test, which show whether the machine itself delays real-time processes.

A run on the machine's clock that is stopped for late ticks may have met a machine that stands
still for milliseconds, or our own tick that takes too long. A witness on each core, above the
priority of all that is ours and with nothing to do, is late in the first case alone.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Self, TypeVar

import pytest

TRIES = 4
STALL_MS = 10
"""Half of the stall that stops a slave on hardware, and of the silence that loses samples; a
slave on a simulated rig has work to do as well."""
Result = TypeVar("Result")

WATCHING = """
import json, os, signal, sys, time
PERIOD_NS = int(sys.argv[2])
os.sched_setaffinity(0, {int(sys.argv[1])})
try:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(95))
except PermissionError:
    pass
ended = []
signal.signal(signal.SIGTERM, lambda *_: ended.append(True))
at_once = 0
print("watching", flush=True)
deadline_ns = time.monotonic_ns()
while not ended:
    deadline_ns += PERIOD_NS
    time.sleep(max(0, deadline_ns - time.monotonic_ns()) * 1e-9)
    skipped = (time.monotonic_ns() - deadline_ns) // PERIOD_NS
    if skipped > 0:
        deadline_ns += skipped * PERIOD_NS
        at_once = max(at_once, skipped)
print(json.dumps({"at_once": at_once}))
"""


class Witness:
    """Bare loops, one on each core; `late` describes their lateness, if there was any."""

    def __init__(self, rate_hz: int) -> None:
        self._period_ns = 10**9 // rate_hz
        self.late = ""

    def __enter__(self) -> Self:
        self._loops = [
            subprocess.Popen(
                [sys.executable, "-ISc", WATCHING, str(cpu), str(self._period_ns)],
                stdout=subprocess.PIPE,
                text=True,
            )
            for cpu in sorted(os.sched_getaffinity(0))
        ]
        for loop in self._loops:
            assert loop.stdout is not None
            assert loop.stdout.readline() == "watching\n"
        return self

    def __exit__(self, *_: object) -> None:
        for loop in self._loops:
            loop.terminate()
        reported = [json.loads(loop.communicate()[0]) for loop in self._loops]
        stall_ms = max(one["at_once"] for one in reported) * self._period_ns * 1e-6
        if stall_ms >= STALL_MS:
            self.late = f"a bare loop stalled for {stall_ms:.0f} ms"


def undisturbed(folder: Path, rate_hz: int, attempt: Callable[[Path], Result | None]) -> Result:
    """Return the result of an attempt, each in a folder of its own.

    One that was held up, and so comes to nothing, is repeated. Where all are held up, the test is
    skipped if bare loops of its rate were late beside half of them or more, and fails if not: a
    bare loop needs next to no processor, and so does not see each core that runs slowly for a
    moment, but our own tick that takes too long takes too long every time.
    """
    seen = []
    for number in range(TRIES):
        with Witness(rate_hz) as witness:
            result = attempt(folder / str(number))
        if result is not None:
            return result
        seen.append(witness.late)
    met = [late for late in seen if late]
    assert len(met) >= TRIES / 2, f"every run was held up, bare loops beside them seldom: {seen}"
    pytest.skip(f"this machine holds real-time processes up in every run: {met[-1]}")
