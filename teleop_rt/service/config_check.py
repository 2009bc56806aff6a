"""Check a config in a process of its own, with bounds of time and memory."""

from __future__ import annotations

import contextlib
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any

CPU_S = 20
"""Of processor time; a check takes 1 to 5 s, most of it to load the program."""
LONGEST_S = 60.0
"""Until it is ended on a machine that is busy, or where it waits for something."""
MOST_BYTES = 2 << 30
"""Of address space; the check of a shipped trial needs less than half of it."""
LONGEST_ANSWER = 20_000
"""Bytes read of a check's output."""
ENDED_FIRST = "1000"
"""Score (proc(5), oom_score_adj) of processes that the kernel ends first if memory runs out."""


class ConfigCheck:
    """`teleop-rt check` of a daemon's config, as its file is now; ends by itself or is ended."""

    def __init__(self, description: Mapping[str, Any]) -> None:
        """Start the check; `description` is the daemon's own (file and overrides)."""
        changes = [part for change in description["overrides"] for part in ("--set", change)]
        self._output: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - read in `problem`
        self.process = subprocess.Popen(  # noqa: S603 - our own interpreter and arguments
            [sys.executable, "-m", "teleop_rt", "check", description["trial_file"], *changes],
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )
        resource.prlimit(self.process.pid, resource.RLIMIT_AS, (MOST_BYTES, MOST_BYTES))
        resource.prlimit(self.process.pid, resource.RLIMIT_CPU, (CPU_S, CPU_S))
        with contextlib.suppress(OSError):  # of a unit without memory left the loop is to stay
            Path(f"/proc/{self.process.pid}/oom_score_adj").write_text(ENDED_FIRST)
        self._until_s = time.monotonic() + LONGEST_S

    @property
    def running(self) -> bool:
        """Whether it still works; one that takes too long is ended."""
        if self.process.poll() is not None:
            return False
        if time.monotonic() > self._until_s:
            self.process.kill()
            self.process.wait()
        return self.process.poll() is None

    def end(self) -> None:
        """End it at once, and forget its output."""
        self.process.kill()
        self.process.wait()
        self._output.close()

    def problem(self) -> str:
        """Return the problems of the config, once the check has ended; empty for none."""
        code = self.process.wait()
        self._output.seek(0)
        said = self._output.read(LONGEST_ANSWER).decode(errors="replace").strip()
        if code < 0:
            return (
                f"the check took more than {LONGEST_S:g} s ({CPU_S} s of processor time) or"
                f" {MOST_BYTES >> 30} GB: make the files smaller, and see `teleop-rt check`"
            )
        return said if code else ""
