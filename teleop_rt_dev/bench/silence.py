"""Longest silence of each command on a terminal."""

from __future__ import annotations

import os
import pty
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from teleop_rt_dev.bench.live import OURS
from teleop_rt_dev.bench.measure import Row, row, take_all_cores
from teleop_rt_dev.paths import SILICONE

LONGEST_S = 2  # of a silence: people take a longer one for a command that hangs
_COLUMNS = "120"
_READ = 1 << 16  # bytes: all that a pseudo-terminal holds


def run(rounds: int) -> list[Row]:
    """Run every command that works for a while once or twice; three minutes or more.

    A command is heard from its start to its end: loading its own program counts as well.
    """
    take_all_cores()
    found: dict[str, list[float]] = {}
    for _ in range(min(rounds, 2)):
        with tempfile.TemporaryDirectory() as name:
            for title, words in commands(Path(name)).items():
                found.setdefault(title, []).append(longest_silence(words))
    return [row(title, "s", values, f"<= {LONGEST_S}") for title, values in found.items()]


def commands(folder: Path) -> dict[str, list[str]]:
    """Return the commands in the order in which one needs the files of another."""
    first, recording = folder / "run", folder / "run" / "recording.mcap"
    simulated = [str(SILICONE), "--clock", "simulated"]
    commands = {
        "run": ["run", *simulated, "--out", first],
        "report": ["report", first, "--figures", folder / "figures"],
        "report --compare": ["report", "--compare", first, first, "--out", folder / "both.html"],
        "runs": ["runs", folder],
        "replay": ["replay", recording],
        "diagnose": ["diagnose", recording, "--out", folder / "diagnosis"],
        "export": ["export", recording, folder / "slave.csv"],
        "close-loop": ["close-loop", *simulated, "--out", folder / "loop"],
        "study excitation": ["study", "excitation", "--out", folder / "study"],
        "check": ["check", SILICONE],
        "doctor": ["doctor", SILICONE],
    }
    campaign = [sys.executable, "-m", "teleop_rt_dev", "campaign", "trial"]
    found = {title: [*OURS, *map(str, words)] for title, words in commands.items()}
    return found | {"campaign trial": [*campaign, "--seeds", "1"]}


def longest_silence(words: Sequence[str]) -> float:
    """Run a command at a terminal of its own; return the longest silence [s]."""
    ours, theirs = pty.openpty()
    shown = os.environ | {"TERM": "xterm-256color", "COLUMNS": _COLUMNS}
    last_s, longest_s = time.monotonic(), 0.0
    with subprocess.Popen(words, stdin=theirs, stdout=theirs, stderr=theirs, env=shown) as process:
        os.close(theirs)
        while heard(ours):
            now_s = time.monotonic()
            last_s, longest_s = now_s, max(longest_s, now_s - last_s)
        longest_s = max(longest_s, time.monotonic() - last_s)
    os.close(ours)
    if process.returncode not in (0, 1):  # 1: a fault of a machine that is late
        raise RuntimeError(f"{shutil.which(words[0])} {' '.join(words[1:])}: {process.returncode}")
    return longest_s


def heard(terminal: int) -> bool:
    """Wait for words at a terminal; return False once its last process has ended."""
    try:
        return bool(os.read(terminal, _READ))
    except OSError:
        return False
