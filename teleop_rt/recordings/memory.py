"""The memory that columns of a recording may take, compared with the sizes in its file."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
from pathlib import Path

from teleop_rt.errors import RecordingError

VARIABLE = "TELEOP_RT_RECORDING_MB"
_MEMORY = Path("/proc/meminfo")
_M_MMAP_THRESHOLD = -3  # of malloc.h
_LARGE_BYTES = 16 << 20
"""A column of half an hour at 1 kHz; the arrays of a diagnosis are smaller."""
_UNKNOWN_BYTES = 4 << 30
"""Taken where the system does not say how much memory is free."""


def most_bytes() -> int:
    """Return how many bytes the columns may take: half of the memory that is free, or as stated.

    Half, because reading takes them twice. Raises RecordingError for a statement that is no number.
    """
    stated = os.environ.get(VARIABLE)
    if stated is None:
        own, _ = resource.getrlimit(resource.RLIMIT_AS)
        free = _free_bytes()
        return (free if own == resource.RLIM_INFINITY else min(free, own)) // 2
    if not (stated.isascii() and stated.isdecimal()):
        raise RecordingError(f"{VARIABLE}={stated}: give a number of megabytes")
    return int(stated) << 20


def return_large_arrays() -> None:
    """Let this process return the memory of a large array to the system when the array is freed.

    glibc does so by itself until the first is freed. From then on it keeps arrays of that size
    for the next one, up to 32 MB, and columns of an hour that were freed stayed: 50 MB.
    """
    with contextlib.suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL(None).mallopt(_M_MMAP_THRESHOLD, _LARGE_BYTES)


def refuse_more(path: Path, needed: int, most: int) -> None:
    """Raise RecordingError where the columns of a file need more bytes than they may take."""
    if needed > most:
        raise RecordingError(
            f"{path}: its columns take {needed >> 20} MB, more than the {most >> 20} MB that a"
            f" recording may take here: give a part of it, or set {VARIABLE}={-(-needed >> 20)}"
        )


def _free_bytes() -> int:
    try:
        lines = _MEMORY.read_text(encoding="ascii").splitlines()
        (available,) = (line.split()[1] for line in lines if line.startswith("MemAvailable:"))
    except (OSError, ValueError):
        return _UNKNOWN_BYTES
    return int(available) << 10
