"""From the command to the first tick of the daemon, everything compiled before; and its memory."""

from __future__ import annotations

import os
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from teleop_rt.realtime.ring import RingReader
from teleop_rt.service.status import SLAVE_RING
from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.paths import SILICONE

PATIENCE_S = 300.0
"""Long enough for the first start, which compiles kernels for the others."""


def run(rounds: int) -> list[Row]:
    """Start the daemon on a rig that is powered, and a whole run at once; once to warm up."""
    take_all_cores()
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # a warm start has its bytecode, too
    count = 1 + max(3, rounds // 5)
    daemon = [_daemon() for _ in range(count)][1:]
    return [
        row(
            "rig powered: warm start of the daemon to first tick",
            "s",
            [one[0] for one in daemon],
            "<= 3",
        ),
        row("of it the daemon's own processor time", "s", [one[2] for one in daemon]),
        row("resident memory of the daemon", "MB", [one[1] for one in daemon], "<= 250"),
        row("of it in no other process", "MB", [one[3] for one in daemon], "<= 120"),
        row(
            "a run: warm start to first tick",
            "s",
            [_whole() for _ in range(count)][1:],
            "<= 2",
        ),
    ]


def _daemon() -> tuple[float, float, float, float]:
    """Return seconds to the first tick, memory [MB], processor time [s], and memory of its own."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TELEOP_RT_RUN_DIR"] = str(folder / "run")
        key = folder / "key"
        subprocess.run([sys.executable, "-m", "teleop_rt", "keygen", key], check=True)
        words = [
            str(SILICONE),
            "--set",
            f"rig.axis.bus.channel=bench-{secrets.token_hex(4)}",
            "--set",
            f"link.slave_port={20000 + secrets.randbelow(10000)}",
            "--json",
        ]
        with _started("sim", *words, "--out", str(folder / "sim")) as rig:
            assert rig.stdout is not None
            rig.stdout.readline()
            began = time.perf_counter()
            more = ["--key", str(key), "--out", str(folder / "slave")]
            with _started("slave", *words, *more) as slave:
                _await_tick(slave, folder / "run")
                taken_s, own = time.perf_counter() - began, _own_megabytes(slave)
                return taken_s, _resident_megabytes(slave), _busy_s(slave), own


def _whole() -> float:
    """Return the seconds from `run` to the first tick of its slave."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ["TELEOP_RT_RUN_DIR"] = str(folder / "run")
        began = time.perf_counter()
        with _started("run", str(SILICONE), "--out", str(folder / "out")) as whole:
            _await_tick(whole, folder / "run")
            return time.perf_counter() - began


def _await_tick(process: subprocess.Popen[str], places: Path) -> None:
    """Wait until a slave's ring holds a row: looked at every few milliseconds."""
    deadline = time.monotonic() + PATIENCE_S
    while process.poll() is None and time.monotonic() < deadline:
        for topic in places.glob("*.rings/slave.topic"):  # written once the ring is complete
            if RingReader(topic.with_name(SLAVE_RING)).newest() is not None:
                return
        time.sleep(0.005)
    raise RuntimeError(f"no tick came of {process.args!r}")


def _resident_megabytes(process: subprocess.Popen[str]) -> float:
    status = Path(f"/proc/{process.pid}/status").read_text()
    (resident,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))
    return int(resident) / 1000


def _own_megabytes(process: subprocess.Popen[str]) -> float:
    lines = Path(f"/proc/{process.pid}/smaps_rollup").read_text().splitlines()
    return sum(int(line.split()[1]) for line in lines if line.startswith("Private_")) / 1000


def _busy_s(process: subprocess.Popen[str]) -> float:
    ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")


@contextmanager
def _started(*words: str) -> Iterator[subprocess.Popen[str]]:
    with subprocess.Popen(
        [sys.executable, "-m", "teleop_rt", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.terminate()
            process.communicate()
