"""Files that a rig names: plain, readable, and no larger than such files are."""

from __future__ import annotations

from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable
    from pathlib import Path

MOST_DESCRIPTION = 8 << 20
"""Of an EDS or DBC [byte]: those of whole cars and large drives have a few megabytes."""
MOST_REPLAYED = 256 << 20
"""Of a bus log or table that is replayed [byte]: hours, and rows that memory can hold."""


def read_description(source: Traversable, what: str) -> bytes:
    """Return the content of a description, each line ended by a line feed.

    Raises AxisError for a file that is larger than any, or cannot be read.
    """
    try:
        with source.open("rb") as file:
            data: bytes = file.read(MOST_DESCRIPTION + 1)
    except OSError as error:
        raise AxisError(
            f"{what} cannot be read: {error.strerror}: let this user read it"
        ) from error
    if len(data) > MOST_DESCRIPTION:
        raise AxisError(
            f"{what}: more than {MOST_DESCRIPTION >> 20} MB describe no device: name another file"
        )
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def refuse_huge(path: Path, what: str) -> None:
    """Raise AxisError for a file that would fill the memory."""
    if path.stat().st_size > MOST_REPLAYED:
        raise AxisError(f"{what} has more than {MOST_REPLAYED >> 20} MB: replay a part of it")
