"""A recorder that is killed again and again during one run: each kill's cost for the recording."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from os import kill
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.realtime.parts import part
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import ONLINE
from teleop_rt.realtime.ring import RingWriter
from teleop_rt.realtime.ring_folder import describe, publish
from teleop_rt.realtime.rotation import SIZES
from teleop_rt.signals import SLAVE, columns
from teleop_rt.trial.folder import RECORDING
from teleop_rt_dev.faults.table import result

KILLED_RECORDERS = "recorder killed: lost of its file"
MOST_LOST_MS = 150
"""Three of the recorder's periods: it waits for one, writes in the next, and may be late."""
STAMP, TICK = columns(SLAVE)["stamp_ns"], columns(SLAVE)["tick"]
METADATA = {
    ONLINE: {"position_unit": "m", "force_unit": "N"},
    SIZES: {"part_bytes": "1000000000", "part_s": "1e9", "kept_bytes": "1", "kept_parts": "0"},
}
PATIENCE_S = 60  # for work of a second at most, on a busy machine too


class Pushing:
    """A loop of 1 kHz that pushes rows and looks after nothing else."""

    def __init__(self, ring: RingWriter) -> None:
        self._ring = ring
        self._row = np.zeros(len(SLAVE))
        self.pushed = 0

    @property
    def newest_ns(self) -> float:
        return float(self._row[STAMP])

    def until(self, done: Callable[[], bool], most_s: float = PATIENCE_S) -> None:
        """Push on until `done()`. Raises TimeoutError."""
        end_s = time.monotonic() + most_s
        while not done():
            begun_s = time.monotonic()
            if begun_s > end_s:
                raise TimeoutError(f"the recorder was not back within {most_s:.0f} s")
            self.pushed += 1
            self._row[STAMP], self._row[TICK] = time.monotonic_ns(), self.pushed
            self._ring.push(self._row)
            time.sleep(max(0.0, begun_s + 1e-3 - time.monotonic()))

    def for_s(self, seconds: float) -> None:
        end_s = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end_s)


def killed_in_one_run(kills: int) -> dict[str, Any]:
    """Kill the recorder of a run so often; how much of the run is not in its file each time?

    The rows that were not there yet must be in the part that the next recorder writes: a row
    that no part holds is lost.
    """
    chosen = random.Random(kills)
    killed_ns: list[float] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        recording = folder / RECORDING
        describe(folder, METADATA)
        ring = publish(folder, "/slave", SLAVE)
        loop = Pushing(ring)
        keeper = keep_recorder(folder)
        try:
            for number in range(1, kills + 2):
                loop.until(part(recording, number).exists)
                loop.for_s(0.2 + 0.3 * chosen.random())
                if number <= kills:
                    killed_ns.append(loop.newest_ns)
                    kill(helper_of(keeper.pid), signal.SIGKILL)
        finally:
            ring.close()
            keeper.terminate()
            keeper.communicate()
        lost_ms = [
            (newest - last_stamp(recording, number)) * 1e-6
            for number, newest in enumerate(killed_ns, 1)
        ]
        missing = loop.pushed - read_topics(recording, ["/slave"])["/slave"]["tick"].size
    worst = max(lost_ms)
    problems = [f"{worst:.0f} ms lost"] * (worst > MOST_LOST_MS)
    problems += [f"{missing} of {loop.pushed} rows are in no part"] * (missing > 0)
    return result(
        KILLED_RECORDERS, kills, "; ".join(problems), f"{missing} rows in no part",
        detected_ms=worst, bound_ms=MOST_LOST_MS, clock="real", phase="contact",
    )  # fmt: skip


def keep_recorder(ring_folder: Path) -> subprocess.Popen[bytes]:
    """Start a recorder under its keeper, as a daemon does."""
    words = ["teleop_rt.service.keeper", "recorder", ring_folder, "teleop_rt.trial.recorder_main"]
    return subprocess.Popen(
        [sys.executable, "-m", *map(str, words), str(ring_folder), str(ring_folder)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def helper_of(keeper: int) -> int:
    """Return the process id of a keeper's helper."""
    (helper,) = Path(f"/proc/{keeper}/task/{keeper}/children").read_text().split()
    return int(helper)


def last_stamp(recording: Path, number: int) -> float:
    """Return the last stamp in the parts up to this one, which a kill has ended."""
    for one in range(number, 0, -1):
        stamps = read_topics(part(recording, one), ["/slave"]).get("/slave", {}).get("stamp_ns")
        if stamps is not None and stamps.size:
            return float(stamps[-1])
    return -np.inf
