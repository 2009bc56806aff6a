"""Leftovers of killed processes in shared memory: named after them, removed by the next start.

A name holds the process id: `teleop-rt-1234-ab12` is a ring folder, `1234-ab12.can` a place on a
bus.
"""

from __future__ import annotations

import os
import re
import shutil
import tempfile
import time
from pathlib import Path

_START_TIME = 18
"""Its place behind the process's state in /proc/PID/stat (proc(5), field 22)."""


def shared_folder() -> Path:
    """Return the folder of files that processes share: in shared memory, where there is some."""
    shared = Path("/dev/shm")  # noqa: S108 - the kernel's shared memory, no file to guess
    return shared if shared.is_dir() else Path(tempfile.gettempdir())


def alive(process: int) -> bool:
    """Return whether a process runs, also one of another user."""
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def began(process: int) -> int | None:
    """Return when a process began, in ticks of the kernel, None where it has ended.

    Number and beginning together are one process's alone, whatever name the kernel lets it have.
    """
    try:
        stat = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
    state, *fields = stat.rpartition(")")[2].split()
    return None if state == "Z" else int(fields[_START_TIME])


def began_ns(process: int) -> int | None:
    """Return when a process began on the monotonic clock [ns], to a tick of the kernel (10 ms).

    None where it has ended, or the system does not say.
    """
    ticks = began(process)
    if ticks is None:
        return None
    age_s = time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    return time.monotonic_ns() - round(age_s * 1e9)


def owner(name: str, prefix: str = "") -> int | None:
    """Return the process in a name `<prefix><pid>-...`, None if there is none."""
    found = re.match(rf"{re.escape(prefix)}([1-9][0-9]*)-", name)
    return int(found[1]) if found else None


def remove_leftovers(folder: Path, prefix: str) -> None:
    """Remove the folders `<prefix><pid>-...` whose process has ended, as far as that is allowed."""
    for path in folder.glob(f"{prefix}*"):
        process = owner(path.name, prefix)
        if process is not None and not alive(process):
            shutil.rmtree(path, ignore_errors=True)
