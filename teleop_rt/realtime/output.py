"""A file that takes everything at once, and hands it to the disk as the disk allows."""

from __future__ import annotations

import os
from pathlib import Path

from teleop_rt.errors import RecordingError

_MOST_AT_ONCE = 1 << 20
"""Bytes of one write."""


class PatientFile:
    """A file whose content waits in memory until `hand_over` writes it to the disk.

    A disk that is full, read-only or broken raises nothing: `problem` has its error, the rest
    keeps waiting, and a later `hand_over` goes on where this one stopped. So the file on the disk
    is at any time the beginning of the whole one.
    """

    def __init__(self, path: Path) -> None:
        """Create the file. Raises RecordingError."""
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        try:
            self._descriptor = os.open(path, flags, 0o644)
        except OSError as error:
            raise RecordingError(
                f"{path}: cannot be written: {error.strerror}"
                ": name a file in a folder that is there and has room"
            ) from None
        self._waiting = bytearray()
        self._taken = 0
        self.problem = ""

    @property
    def waiting_bytes(self) -> int:
        """How much is not on the disk yet."""
        return len(self._waiting)

    def tell(self) -> int:
        """Return how many bytes were taken."""
        return self._taken

    def write(self, data: bytes) -> int:
        """Take data; never fails."""
        self._waiting += data
        self._taken += len(data)
        return len(data)

    def flush(self) -> None:
        """Do nothing: `hand_over` does the work."""

    def hand_over(self) -> bool:
        """Write the waiting bytes to the disk; return whether it took all of them."""
        try:
            while self._waiting:
                written = os.write(self._descriptor, self._waiting[:_MOST_AT_ONCE])
                del self._waiting[:written]
        except OSError as error:
            self.problem = error.strerror or str(error)
            return False
        self.problem = ""
        return True

    def close(self) -> None:
        """Write as much as the disk takes, and close."""
        self.hand_over()
        os.close(self._descriptor)
