"""Measure how long a stop takes from its request to the drive's order, while others ask, too.

    scripts/campaign stop [--rounds N] [--json]

Real processes at 200 Hz: the simulated CANopen rig, a daemon, and whoever keeps it busy. The time
is from the request at the control socket to the frame that takes the drive out of operation, as its
sender stamped it; ticks are the SYNC frames in between. 50 ms are allowed; exits with 1 beyond.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from pathlib import Path
from typing import Any

from teleop_rt_dev.service.stop_lab import BUSY, StopLab

ALLOWED_MS = 50.0
"""Below the watchdogs of the simulated drives, which stop by themselves after 60 ms."""


def main(arguments: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="teleop-rt-dev campaign stop", description=__doc__.splitlines()[0]
    )
    parser.add_argument("--rounds", type=int, default=10)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args(arguments)
    worst = 0.0
    with tempfile.TemporaryDirectory() as folder:
        stop_lab = StopLab(Path(folder))
        with stop_lab.running():
            for name, busy in BUSY.items():
                taken = [stop_lab.stop_while(busy) for _ in range(options.rounds)]
                times = [1e3 * one.seconds for one in taken]
                row: dict[str, Any] = {
                    "while": name,
                    "rounds": len(taken),
                    "median_ms": statistics.median(times),
                    "max_ms": max(times),
                    "ticks_max": max(one.ticks for one in taken),
                }
                worst = max(worst, row["max_ms"])
                if options.json:
                    print(json.dumps(row), flush=True)
                else:
                    took = f"median {row['median_ms']:6.1f} ms, at most {row['max_ms']:6.1f} ms"
                    print(f"{name:36} {took}, {row['ticks_max']} ticks", flush=True)
    return 1 if worst > ALLOWED_MS else 0
