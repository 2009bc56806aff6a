"""The rows of the fault table that take real processes: killed, frozen, and a disk that is full."""

from __future__ import annotations

import json
import math
import os
import secrets
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.realtime.parts import parts
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.ring import RingReader
from teleop_rt.signals import SLAVE, TRUTH, columns
from teleop_rt_dev.faults.table import result
from teleop_rt_dev.paths import SILICONE

WITHOUT_VOLTAGE = 0  # of the column drive_mode: the simulated drive does nothing
RECORDER = "recorder"
PERIOD_NS = 1_000_000  # of the shipped rigs: 1 kHz
ENDING_S = 10  # for a slave whose ring is gone, to end
COLUMN, TRUE = columns(SLAVE), columns(TRUTH)


class Sides:
    """Simulated rig, slave and master, each started alone, until the slave is in contact."""

    def __init__(
        self,
        folder: Path,
        changes: Sequence[str] = (),
        own: Mapping[str, Sequence[str]] | None = None,
    ) -> None:
        """Start them with changes of the trial; `own` are those of single sides."""
        ports = [20000 + secrets.randbelow(20000) for _ in range(2)]
        sets = [f"link.slave_port={ports[0]}", f"link.master_port={ports[1]}", *changes]
        self._own = own or {}
        sets += [f"rig.axis.bus.channel=faults-{secrets.token_hex(4)}"]
        sets += ["duration_s=120.0", "operator.lift_off_every_s=100.0"]
        self.folder = folder
        self._changes = [part for one in sets for part in ("--set", one)]
        self._environment = os.environ | {"TELEOP_RT_RUN_DIR": str(folder / "run")}
        key = folder / "key"
        self._command("keygen", key).wait()
        self.processes: dict[str, subprocess.Popen[str]] = {}
        for name, more in (
            ("sim", []),
            ("slave", ["--key", key, "--arm"]),
            ("master", ["--key", key]),
        ):
            self.processes[name] = self._start(name, *more)

    def _command(self, *words: Any) -> subprocess.Popen[str]:
        return subprocess.Popen(
            [sys.executable, "-m", "teleop_rt", *map(str, words)],
            stdout=subprocess.PIPE,
            text=True,
            env=self._environment,
        )

    def _start(self, name: str, *more: Any) -> subprocess.Popen[str]:
        out = self.folder / name
        changes = [*self._changes, *(p for one in self._own.get(name, ()) for p in ("--set", one))]
        process = self._command(name, SILICONE, *changes, "--out", out, "--json", *more)
        assert process.stdout is not None
        for line in process.stdout:
            if json.loads(line)["event"] == "ready":
                return process
        raise RuntimeError(f"{name} did not start")

    def ring(self, name: str, topic: str) -> RingReader:
        """Raises FileNotFoundError where the side has ended already."""
        pid = self.processes[name].pid
        for ring_folder in Path("/dev/shm").glob(f"teleop-rt-{pid}-*"):
            return RingReader(ring_folder / f"{topic}.ring")
        raise FileNotFoundError(name)

    def child(self, parent: int, word: str = "") -> int:
        """Return the process id of a child, by a word of its command line."""
        for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split():
            if not word or word.encode() in Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0"):
                return int(pid)
        raise RuntimeError(f"{parent} has no child {word}")

    def moving_in_contact(self) -> bool:
        """Wait until the tool presses and moves; false where the slave has stopped instead."""
        try:
            slave, truth = self.ring("slave", "slave"), self.ring("sim", "truth-plant")
        except FileNotFoundError:
            return False
        since = time.monotonic()
        while time.monotonic() - since < 30:
            row, true = slave.newest(), truth.newest()
            assert true is not None
            if row is not None and row[COLUMN["fault"]]:
                return False
            met = row is not None and row[COLUMN["contact_id"]] >= 1
            if met and abs(true[TRUE["velocity"]]) > 0.05 and true[TRUE["force"]] > 10:
                return True
            time.sleep(0.0005)
        return False

    def close(self) -> None:
        for process in self.processes.values():
            process.send_signal(signal.SIGCONT)
            process.terminate()
        for process in self.processes.values():
            process.communicate()


def timed(
    fault: str, tries: int, taken: list[float], bound_ms: float, peak: float | None
) -> dict[str, Any]:
    """Make a row of the campaign out of how long each kill took."""
    worst = max(taken, default=None)
    if len(taken) < tries:
        problem = f"only {len(taken)} of {tries} trials came into contact on this machine"
    else:
        problem = "" if max(taken) <= bound_ms else f"{[round(ms) for ms in taken]} ms"
    return result(
        fault, tries, problem, "-", played=len(taken), phase="contact", clock="real",
        detected_ms=worst, bound_ms=bound_ms, peak_force_N=peak,
    )  # fmt: skip


def until_stopped(truth: RingReader, killed_ns: int) -> tuple[float, float]:
    """Return when the motor had stopped and lost its voltage [ms], and the peak force [N] after.

    The simulated rig looks at its motor each 5 ms once no SYNC comes any more.
    """
    time.sleep(0.5)
    rows = truth.read()
    after = rows[rows[:, TRUE["stamp_ns"]] >= killed_ns]
    powered = np.flatnonzero(after[:, TRUE["drive_mode"]] != WITHOUT_VOLTAGE)
    off = powered[-1] + 1 if powered.size else 0
    stopped_ns = after[off, TRUE["stamp_ns"]] if off < len(after) else math.inf
    return (stopped_ns - killed_ns) * 1e-6, float(np.max(np.abs(after[:, TRUE["force"]])))


def harm(how: str, kills: int) -> dict[str, Any]:
    """Kill or freeze so often; a trial that this machine ended before its time is tried again."""
    taken: list[float] = []
    peaks: list[float] = []
    bounds = {"daemon killed": 70, "daemon frozen": 70}
    for _ in range(3 * kills):
        if len(taken) == kills:
            break
        with tempfile.TemporaryDirectory() as name:
            sides = Sides(Path(name))
            try:
                if not sides.moving_in_contact():
                    continue
                if how in bounds:
                    number = signal.SIGKILL if how == "daemon killed" else signal.SIGSTOP
                    truth = sides.ring("sim", "truth-plant")
                    sides.processes["slave"].send_signal(number)
                    ms, peak = until_stopped(truth, time.monotonic_ns())
                    peaks.append(peak)
                else:
                    time.sleep(1.0)
                    ms = lost_of_recording(sides, how)
                taken.append(ms)
            except FileNotFoundError:
                sides.processes["slave"].wait(ENDING_S)  # or it has not ended, and something is odd
            finally:
                sides.close()
    name = "recorder killed: the daemon's gap" if how == RECORDER else how
    return timed(name, kills, taken, bounds.get(how, 150), max(peaks, default=None))


def lost_of_recording(sides: Sides, how: str) -> float:
    """Kill the recorder or the slave; return how much of the slave's time is missing [ms]."""
    slave = sides.ring("slave", "slave")
    recording = sides.folder / "slave" / "recording.mcap"
    if how == RECORDER:
        os.kill(sides.child(sides.child(sides.processes["slave"].pid, RECORDER)), signal.SIGKILL)
        time.sleep(1.0)
        stamps = read_topics(recording, ["/slave"])["/slave"]["stamp_ns"]
        assert len(parts(recording)) == 2
        return float(np.max(np.diff(stamps)[-1000:]) - PERIOD_NS) * 1e-6
    sides.processes["slave"].kill()
    newest = slave.newest()
    assert newest is not None
    time.sleep(0.5)
    left = read_topics(recording, ["/slave"])["/slave"]
    return max(0.0, float(newest[COLUMN["stamp_ns"]] - left["stamp_ns"][-1]) * 1e-6)


def killed_processes(kills: int) -> Iterator[tuple[str, Callable[[], dict[str, Any]]]]:
    """Give name and work of each way to harm a process."""
    for how in ("daemon killed", "daemon frozen", "slave killed: recording", RECORDER):
        yield how, partial(harm, how, kills)
