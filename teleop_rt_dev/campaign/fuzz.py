"""Feed damaged input to everything that reads some: a traceback, a hang or growth is a failure.

    scripts/campaign fuzz [--seconds S] [--seed N] [--target NAME]... [--json]

Seconds are shared by the targets: link, control socket, YAML, recordings, EDS, DBC, bus frames,
actuators, lines. A case that raises other than ExpectedError, works for over 5 s, or grows by
more than 200 MB is written to fuzz-TARGET-SEED-CASE and ends the campaign with exit code 1.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import random
import signal
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

from teleop_rt_dev.fuzz_damage import Target
from teleop_rt_dev.fuzz_targets import TARGETS

HANG_S = 5
"""Of processor time: other work of the machine is no hang."""
LONGEST_S = 60
"""Of any time, for a case that waits instead of working."""
MOST_GROWTH_KIB = 200 * 1024  # of all cases of a kind: a leak grows with each of thousands
REPEATED = 3
"""Cases of a kind kept in memory while caches fill: growth is counted from then on."""


class Hang(BaseException):
    """A case that took too long; no handler of the program's catches it."""


def resident_kib() -> int:
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def on_alarm(_number: int, _frame: FrameType | None) -> None:
    raise Hang


def run_case(target: Target, rng: random.Random) -> str:
    """Run one case; return its failure, empty for none."""
    signal.alarm(LONGEST_S)
    signal.setitimer(signal.ITIMER_PROF, HANG_S)
    try:
        target.run(rng)
    except Hang:
        return f"hung for more than {HANG_S} s\n{traceback.format_exc(limit=-6)}"
    except Exception:  # noqa: BLE001 - every exception is a finding
        return traceback.format_exc(limit=-8)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.alarm(0)
    return ""


def fuzz(name: str, make: Callable[[Path], Target], seconds: float, seed: int) -> dict[str, Any]:
    """Run one target's cases for so long; return the findings."""
    with tempfile.TemporaryDirectory() as folder:
        target = make(Path(folder))
        with contextlib.suppress(Exception):  # a reader that fails here fails at the first case
            target.warm_up()
        found: dict[str, Any] = {"target": name, "cases": 0, "problem": None, "growth_KiB": 0}
        resident: int | None = None
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s and found["problem"] is None:
            case = found["cases"]
            problem = run_case(target, random.Random(f"{name} {seed} {case}"))
            found["cases"] += 1
            if found["cases"] == REPEATED:
                resident = resident_kib()
            grown = 0 if resident is None else resident_kib() - resident
            found["growth_KiB"] = grown
            if not problem and grown > MOST_GROWTH_KIB:
                problem = f"the process grew by {grown} KiB"
            if problem:
                kept = Path(f"fuzz-{name}-{seed}-{case}")
                kept.write_bytes(target.last)
                found["problem"] = f"case {case}, kept as {kept}: {problem}"
        return found


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign fuzz", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--target", action="append", choices=sorted(TARGETS))
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    warnings.simplefilter("error")
    for number in (signal.SIGALRM, signal.SIGPROF):
        signal.signal(number, on_alarm)
    names = options.target or list(TARGETS)
    share_s = options.seconds / len(names)
    results = [fuzz(name, TARGETS[name], share_s, options.seed) for name in names]
    for result in results:
        if options.json:
            print(json.dumps(result))
        else:
            verdict = result["problem"] or "nothing found"
            print(f"{result['target']:10} {result['cases']:7} cases, {verdict}", flush=True)
    return 1 if any(result["problem"] for result in results) else 0
