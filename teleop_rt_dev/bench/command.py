"""Run benches by name and print their figures: see scripts/bench."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from collections.abc import Sequence
from pathlib import Path

from teleop_rt_dev.bench.measure import Row

NAMES = (
    "bank",
    "replay",
    "peers",
    "windup",
    "fit",
    "io",
    "link",
    "live",
    "pages",
    "silence",
    "long",
    "many",
    "loop",
    "tick",
    "rig",
    "lockstep",
    "master",
    "alloc",
    "log",
    "startup",
    "diagnosis",
)
ON_REQUEST = ("before", "steady")
"""Benchmarks that need an older commit or a long time, and are therefore not part of all."""


def machine() -> str:
    """Print the machine of these figures."""
    model = platform.processor() or platform.machine()
    info = Path("/proc/cpuinfo")
    if info.exists():
        lines = info.read_text().splitlines()
        named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
        model = named[0] if named else model
    return f"{model}, Python {platform.python_version()}"


LEAST_ROUNDS = 3  # a median of fewer is their mean or one of them


def pin() -> None:
    """Keep this process on one core, so that both sides of a ratio see the same clock."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def show(bench: str, rows: Sequence[Row]) -> None:
    """Print a bench as a table."""
    print(f"{bench}:")
    for row in rows:
        numbers = [row["median"], row["min"], row["max"]]
        shown = "  ".join("       -" if n is None else f"{n:>8.3g}" for n in numbers)
        held = row["holds"]
        verdict = "" if held is None else "holds" if held else "FAILS"
        print(f"  {row['name']:<58} {shown}  {row['unit']:<10} {row['bar'] or '':<10} {verdict}")


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="teleop-rt-dev bench", description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help=f"of {', '.join((*NAMES, *ON_REQUEST))}"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object per bench and line")
    parser.add_argument("--rounds", type=int, default=15, help="rounds per ratio")
    chosen = parser.parse_args(arguments)
    unknown = set(chosen.names) - {*NAMES, *ON_REQUEST}
    if chosen.rounds < LEAST_ROUNDS:
        parser.error(f"--rounds {chosen.rounds}: at least {LEAST_ROUNDS}, for a median")
    if unknown:
        parser.error(f"unknown bench {sorted(unknown)}: choose from {', '.join(NAMES)}")
    pin()
    held = True
    for name in chosen.names or NAMES:
        rows = importlib.import_module(f"{__package__}.{name}").run(chosen.rounds)
        held = held and all(row["holds"] is not False for row in rows)
        if chosen.json:
            print(json.dumps({"bench": name, "machine": machine(), "rows": rows}), flush=True)
        else:
            show(name, rows)
    return 0 if held else 1
