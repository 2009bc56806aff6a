"""200 recordings by `replay`: two local workers against one, and after a kill in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from teleop_rt_dev.bench.measure import Row, ratios, row, take_all_cores

RECORDINGS = 200  # enough that starting the workers counts little
SECONDS, RATE_HZ = 5.0, 500.0


def write_presses(folder: Path) -> None:
    """Write the recordings: springs and dampers of all kinds, pressed from free air."""
    folder.mkdir()
    t = np.arange(0.0, SECONDS, 1.0 / RATE_HZ)
    for seed in range(RECORDINGS):
        rng = np.random.default_rng(seed)
        k, b, f = rng.uniform(300.0, 4000.0), rng.uniform(1.0, 30.0), rng.uniform(0.8, 3.0)
        x = 0.004 - 0.008 * np.cos(2.0 * np.pi * f * t)
        force = np.where(x > 0.0, k * x + b * np.gradient(x, t), 0.0)
        force += rng.normal(0.0, 0.02, t.size)
        np.savez(folder / f"{seed:03}.npz", t_s=t, position_m=x, force_N=force)


def replay(folder: Path, *options: str) -> list[str]:
    """Return the command over all recordings."""
    return [sys.executable, "-m", "teleop_rt", "replay", str(folder), "--json", *options]


def timed(command: list[str]) -> tuple[float, bytes]:
    """Return the time of a command [s], and its output."""
    begun = time.perf_counter()
    done = subprocess.run(command, capture_output=True, check=True)
    return time.perf_counter() - begun, done.stdout


def killed_and_resumed(folder: Path, out: Path) -> tuple[int, float, bytes]:
    """Kill the work at a half; return the answers kept, and time and output of the same again."""
    command = replay(folder, "--jobs", "2", "--out", str(out))
    begun = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
    )
    if begun.stdout is None:
        raise RuntimeError("no pipe")
    for _ in range(RECORDINGS // 2):
        begun.stdout.readline()
    os.killpg(begun.pid, signal.SIGKILL)
    begun.communicate()
    kept = (out / "cases.jsonl").read_bytes().count(b"\n")
    return kept, *timed(command)


def run(rounds: int) -> list[Row]:
    take_all_cores()
    with tempfile.TemporaryDirectory() as name:
        folder, out = Path(name) / "presses", Path(name) / "out"
        write_presses(folder)
        timed(replay(folder / "000.npz"))  # kernels are compiled
        sides = [
            [timed(replay(folder, "--jobs", jobs)) for jobs in "12"] for _ in range(min(rounds, 3))
        ]
        kept, again_s, again = killed_and_resumed(folder, out)
    times = [[one[0] for one in pair] for pair in sides]
    answers = {one[1] for pair in sides for one in pair} | {again}
    return [
        row(
            "200 recordings of 5 s at 500 Hz, 45 estimators, one worker", "s", [t[0] for t in times]
        ),
        row("two workers", "s", [t[1] for t in times]),
        row("one worker / two workers", "ratio", ratios(times, 0, 1), ">= 1.6"),
        row("different outputs of all these", "count", [len(answers)], "<= 1"),
        row("killed after 100 lines: answers kept", "count", [kept], ">= 100"),
        row("the same command again, on two workers", "s", [again_s]),
    ]
