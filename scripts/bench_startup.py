"""From the command to the first tick of the daemon, everything compiled before; and its memory."""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench_measure import Row, row

TRIAL = Path(__file__).resolve().parents[1] / "config" / "trials" / "silicone_cube.yaml"


def run(rounds: int) -> list[Row]:
    """Start the daemon on its simulated rig, once to warm up, then a few times."""
    measured = [_start() for _ in range(1 + max(3, rounds // 5))][1:]
    return [
        row("warm start to first tick", "s", [one[0] for one in measured], "<= 3"),
        row("of it the daemon's own processor time", "s", [one[2] for one in measured]),
        row("resident memory of the daemon", "MB", [one[1] for one in measured], "<= 250"),
    ]


def _start() -> tuple[float, float, float]:
    port = f"rig.axis.bus.port={20000 + secrets.randbelow(20000)}"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        environment = os.environ | {"TELEOP_RT_RUN_DIR": str(folder / "run")}
        key = folder / "key"
        subprocess.run([sys.executable, "-m", "teleop_rt", "keygen", key], check=True)
        words = [str(TRIAL), "--set", port, "--json"]
        rig = _until_ready(["sim", *words, "--out", str(folder / "sim")], environment)
        began = time.perf_counter()
        more = ["--key", str(key), "--out", str(folder / "slave")]
        slave = _until_ready(["slave", *words, *more], environment)
        took = time.perf_counter() - began
        status = Path(f"/proc/{slave.pid}/status").read_text()
        (resident,) = (line.split()[1] for line in status.splitlines() if line.startswith("VmRSS"))
        ticks = Path(f"/proc/{slave.pid}/stat").read_text().rpartition(")")[2].split()[11:13]
        busy = sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
        for process in (slave, rig):
            process.terminate()
            process.communicate()
    return took, int(resident) / 1000, busy


def _until_ready(words: list[str], environment: dict[str, str]) -> subprocess.Popen[str]:
    process = subprocess.Popen(
        [sys.executable, "-m", "teleop_rt", *words],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    )
    assert process.stdout is not None
    for line in process.stdout:
        if json.loads(line)["event"] == "ready":
            return process
    raise RuntimeError(f"{words[0]} did not start")
