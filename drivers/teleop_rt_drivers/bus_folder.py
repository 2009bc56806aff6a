"""The folder that is a bus of `unix_bus`: a socket in it is a program on the bus."""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path

from teleop_rt.realtime.leftovers import alive, owner, shared_folder

_MODE = 0o700  # of a bus's folder: other users take no part
SUFFIX = ".can"
"""How the name of a program's socket ends; the name begins with the program's process."""


def folder_of(channel: str) -> Path:
    """Return the folder of a bus: the channel is its path, or a name for this user alone."""
    return Path(channel) if "/" in channel else shared_folder() / f"{_own_prefix()}{channel}"


def sweep_buses() -> None:
    """Remove the files of named buses that killed programs of this user left."""
    for place in shared_folder().glob(f"{_own_prefix()}*"):
        with contextlib.suppress(OSError):
            folder = _open(place)
            try:
                fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
                for name in names_in(folder):
                    if (process := owner(name)) is not None and not alive(process):
                        os.unlink(name, dir_fd=folder)
                place.rmdir()
            finally:
                os.close(folder)


def _own_prefix() -> str:
    return f"can-{os.getuid()}-"


def _open(place: Path) -> int:
    return os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)


def entered(place: Path) -> int:
    """Return the folder of a bus, open and locked: made, where the last program has removed it.

    Raises OSError.
    """
    while True:
        place.mkdir(_MODE, parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            folder = _open(place)
            fcntl.flock(folder, fcntl.LOCK_EX)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(folder), place.stat()):
                    return folder
            os.close(folder)


def names_in(folder: int) -> list[str]:
    """Return the places of programs in the folder of a bus."""
    there = os.listdir(folder)
    return [name for name in there if name.endswith(SUFFIX)]
