"""No existing file is overwritten: the one place that refuses, with the next step.

Work that may be resumed (`batch.sweep.open_folder`) names its owner in a note in its folder.
"""

from __future__ import annotations

import errno
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from teleop_rt.errors import ExpectedError

DISK_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""Errors of a disk that has no room: full, quota, file limit."""


class OutputError(ExpectedError):
    """A file or folder cannot be written to; the message names it, the cause and the next step."""


def refuse_existing(paths: Iterable[Path], what_next: str = "name another file") -> None:
    """Raise OutputError where a file that would be written is there."""
    if there := [str(path) for path in paths if path.exists() or path.is_symlink()]:
        raise OutputError(f"{', '.join(there)}: already exists: {what_next}, or remove it")


def refuse_filled(folder: Path, what_next: str = "name another folder with --out") -> None:
    """Raise OutputError where a folder that would be written into is a file, or not empty."""
    refuse_file(folder, what_next)
    if folder.is_dir() and any(folder.iterdir()):
        raise OutputError(f"{folder}: is not empty: {what_next}")


def refuse_file(folder: Path, what_next: str = "name another folder with --out") -> None:
    """Raise OutputError where a folder that would be written into is a file, or below one."""
    place = next((one for one in (folder, *folder.absolute().parents) if one.exists()), folder)
    if place.exists() and not place.is_dir():
        raise OutputError(f"{place}: is a file: {what_next}")


def refuse_unwritable(folder: Path, what_next: str = "name another folder with --out") -> None:
    """Raise OutputError where a folder cannot be made, or nothing can be written into it.

    Nothing is left: the next folder above that exists is tried.
    """
    place = next(one for one in (folder, *folder.absolute().parents) if one.exists())
    try:
        with tempfile.TemporaryFile(dir=place):
            pass
    except OSError as error:
        raise unwritable(folder, error, what_next) from None


def unwritable(
    folder: Path, error: OSError, what_next: str = "name another folder with --out"
) -> OutputError:
    """Return the refusal of a folder that cannot be made, or into which nothing can be written."""
    if error.errno in DISK_FULL:
        what_next = f"make room, or {what_next}"
    return OutputError(f"{folder}: cannot be made or written: {error.strerror}: {what_next}")


def write_whole(path: Path, text: str) -> None:
    """Write a text file: whole, or, on a full disk, not at all.

    Raises OSError, which names the file.
    """
    unfinished = path.with_name(f"{path.name}.part")
    try:
        unfinished.write_text(text, encoding="utf-8")
        unfinished.rename(path)
    except OSError as error:
        unfinished.unlink(missing_ok=True)
        error.filename = str(path)
        raise


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name a path in an OSError that names none, as the system's of a full disk."""
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


@contextmanager
def whole_or_nothing(folder: Path) -> Iterator[None]:
    """Remove a folder, or new files in it, where an error ends its writing; old files stay."""
    missing = [one for one in (folder, *folder.absolute().parents) if not one.exists()]
    before = set() if missing else set(folder.iterdir())
    try:
        yield
    except BaseException:
        begun = missing[-1:] or [one for one in folder.iterdir() if one not in before]
        for path in begun:
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)
        raise
