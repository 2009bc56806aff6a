"""Pages that a fork shares with its origin until it writes them, copied before a loop starts."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterator
from pathlib import Path

MAPS = Path("/proc/self/smaps")
_MADV_POPULATE_WRITE = 23  # of sys/mman.h, since Linux 5.14


def own_written_pages() -> int:
    """Copy the pages in use that this process may write, as its first write would; return bytes.

    After a fork every counted reference is such a write: the first tick alone would copy hundreds
    of pages. Does nothing on a system without /proc or older than Linux 5.14.
    """
    owned = 0
    with contextlib.suppress(OSError, AttributeError):
        madvise = ctypes.CDLL(None).madvise
        for start, end in in_use(MAPS.read_text(encoding="utf-8")):
            place, length = ctypes.c_void_p(start), ctypes.c_size_t(end - start)
            if madvise(place, length, _MADV_POPULATE_WRITE) == 0:
                owned += end - start
    return owned


def in_use(maps: str) -> Iterator[tuple[int, int]]:
    """Yield start and end of private mappings, open to writing, that are at least half in memory.

    `maps` is the text of /proc/self/smaps. The others, such as stacks, would only grow.
    """
    start = end = 0
    wanted = False
    for line in maps.splitlines():
        first, second = line.split(maxsplit=2)[:2]
        if not first.endswith(":"):
            start, end = (int(address, 16) for address in first.split("-"))
            wanted = second.startswith("rw") and second.endswith("p")
        elif first == "Rss:" and wanted and 2 * 1024 * int(second) >= end - start:
            yield start, end
