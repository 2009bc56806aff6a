"""The parts of a recording: `NAME.mcap`, then `NAME.part0002.mcap` and so on, read as one.

A new part begins where a recorder was started again, and where the last one has become large or
old. The oldest may have been removed to make room.
"""

from __future__ import annotations

import glob
import re
from pathlib import Path


def part(recording: Path, number: int) -> Path:
    """Return the path of a part, counted from 1."""
    if number == 1:
        return recording
    return recording.with_suffix(f".part{number:04}{recording.suffix}")


def number_of(path: Path, recording: Path) -> int | None:
    """Return which part of the recording a file is, None where it is none."""
    if path == recording:
        return 1
    stem, suffix = re.escape(recording.stem), re.escape(recording.suffix)
    found = re.fullmatch(rf"{stem}\.part([0-9]{{4,}}){suffix}", path.name)
    return int(found[1]) if found else None


def parts(recording: Path) -> list[Path]:
    """Return the parts that there are, oldest first; for a part's own path that part alone."""
    numbered = (
        (number, path)
        for path in recording.parent.glob(f"{glob.escape(recording.stem)}*{recording.suffix}")
        if (number := number_of(path, recording)) is not None
    )
    return [path for _, path in sorted(numbered)]
