"""The whole tick now over that of an older commit, both measured in turn on this machine.

    scripts/bench before [--rounds N]

The older commit lies in a folder of its own (git worktree), removed in the end; the packages it
needs are those installed here. TELEOP_RT_BEFORE names another commit than the default. Each round
measures both, one after the other, and the ratio is of a round: other load meets both sides. Each
round is printed as it ends, so that a run that is cut off has not been for nothing.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.paths import ROOT

BEFORE = os.environ.get("TELEOP_RT_BEFORE", "2529d19")
RIGS = ("canopen", "serial", "mixed")
RATE_HZ = 1000  # of the shipped rigs
MAX_RATIO = {"p50": 0.35, "p99": 0.4}
"""The aim of a tick in one compiled step, as a share of the older commit's time."""


def run(rounds: int) -> list[Row]:
    """Measure both sides of each rig in turn; a third of the rounds suffices."""
    take_all_cores()
    found = []
    with _tree(BEFORE) as before:
        for rig in RIGS:
            pairs = [_pair(before, rig) for _ in range(max(3, rounds // 3))]
            for key, most in MAX_RATIO.items():
                shares = [new[key] / old[key] for old, new in pairs]
                found += [
                    row(f"{rig}, {BEFORE}, work {key}", "us", [old[key] for old, _ in pairs]),
                    row(f"{rig}, now, work {key}", "us", [new[key] for _, new in pairs]),
                    row(f"{rig}, now over {BEFORE}, {key}", "x", shares, f"<= {most}"),
                ]
    return found


@contextmanager
def _tree(commit: str) -> Iterator[Path]:
    folder = Path(tempfile.mkdtemp(prefix="teleop-rt-before-"))
    git = ["git", "-C", str(ROOT), "worktree"]
    try:
        subprocess.run([*git, "add", "--quiet", "--detach", str(folder), commit], check=True)
        yield folder
    finally:
        subprocess.run([*git, "remove", "--force", str(folder)], check=False)
        shutil.rmtree(folder, ignore_errors=True)


def _pair(before: Path, rig: str) -> tuple[dict[str, float], dict[str, float]]:
    """Measure both sides once, and print their times."""
    old, new = _tick(before, rig), _tick(ROOT, rig)
    found = ", ".join(f"{key} {new[key]:.0f} of {old[key]:.0f} us" for key in MAX_RATIO)
    print(f"{rig}: {found}", file=sys.stderr, flush=True)
    return old, new


def _tick(tree: Path, rig: str) -> dict[str, float]:
    """Return p50 and p99 of the work of a tick [us] of the program in `tree`."""
    folders = (tree, tree / "drivers", tree / "scripts", tree / "tests")
    script = tree / "scripts" / "bench_tick.py"  # where older commits have it
    bench = [str(script)] if script.exists() else ["-m", "teleop_rt_dev.bench.tick"]
    done = subprocess.run(
        [sys.executable, *bench, rig, str(RATE_HZ)],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        cwd=tree,  # `python -m`, as the sides are started, looks there first
        env=os.environ | {"PYTHONPATH": os.pathsep.join(map(str, folders))},
    )
    found: dict[str, float] = json.loads(done.stdout)
    return found
