"""Recording a tick: into the ring, against writing the MCAP file from the loop."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from teleop_rt.config.section import Units
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring import RingWriter
from teleop_rt.realtime.ring_folder import new_ring_folder
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.signals import SLAVE
from teleop_rt_dev.bench.measure import Row, row

T = TypeVar("T")
TICKS = 50_000  # 50 s at 1 kHz
FLUSH_EVERY = 50  # ticks, as the recorder does
SHARES = (0.5, 0.99, 0.9999)  # quantiles that are printed
LIKE_A_PUSH = 28
"""Additions that take as long as pushing a row; their slowest ten-thousandth is the machine's."""


def run(rounds: int) -> list[Row]:
    """Time each write of both, as the loop would make it; judged by the slowest in ten thousand."""
    times = [_each() for _ in range(max(3, rounds // 3))]
    found = []
    for index, share in enumerate(SHARES):
        label = f"p{100 * share:g}"
        for place, name in enumerate(("ring", "MCAP from the loop", "plain Python")):
            found.append(row(f"{name}, {label}", "us", [one[place][index] for one in times]))
    ratios = [mcap[2] / ring[2] for ring, mcap, _ in times]
    found.append(row("MCAP over ring, p99.99", "x", ratios, ">= 10"))
    return found


def _each() -> list[list[float]]:
    """Measure in a process of its own: real-time scheduling sticks to a process."""
    itself = [sys.executable, "-m", __name__]
    done = subprocess.run(itself, capture_output=True, text=True, check=True)
    taken: list[list[float]] = json.loads(done.stdout)
    return taken


def measure() -> list[list[float]]:
    """Return the quantiles of both [us], and of plain Python that takes as long as the ring.

    Each gets a row as it takes it best: the ring a list, as from the loop, the file an array.
    """
    rows = np.random.default_rng(1).normal(size=(1000, len(SLAVE)))
    rows[:, 1] = np.arange(1000) * 1e6
    with new_ring_folder() as ring_folder, tempfile.TemporaryDirectory() as name:
        ring = RingWriter(ring_folder / "r", len(SLAVE), 8192)
        writer = RecordingWriter(Path(name) / "r.mcap", Units(position="m", force="N"))
        writer.add_topic("/slave", SLAVE)
        prepare_process(60)
        ticks = 0

        def direct(one: np.ndarray) -> None:
            nonlocal ticks
            writer.write_rows("/slave", one[None])
            ticks += 1
            if ticks % FLUSH_EVERY == 0:
                writer.flush()

        def plain(_: object) -> None:
            total = 0
            for number in range(LIKE_A_PUSH):
                total += number & 15

        each = [
            _timed(ring.push, rows.tolist()),
            _timed(direct, list(rows)),
            _timed(plain, list(rows)),
        ]
        ring.close()
        writer.close()
    return each


def _timed(write: Callable[[T], None], rows: Sequence[T]) -> list[float]:
    taken = np.zeros(TICKS)
    now = time.perf_counter_ns
    for tick in range(TICKS):
        one = rows[tick % 1000]
        start = now()
        write(one)
        taken[tick] = now() - start
    return [float(value) * 1e-3 for value in np.quantile(taken, SHARES)]


if __name__ == "__main__":
    print(json.dumps(measure()))
