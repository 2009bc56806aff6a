"""Which recordings a command line names: files, run folders, folders of these, and globs."""

from __future__ import annotations

import glob
import hashlib
import re
from collections.abc import Iterator, Sequence
from itertools import chain, count
from pathlib import Path

from teleop_rt.batch.sweep import ABOUT
from teleop_rt.errors import RecordingError
from teleop_rt.realtime.parts import parts
from teleop_rt.trial.folder import RECORDING, TRIAL

SUFFIXES = (".mcap", ".csv", ".mat", ".npz")
_LATER_PART = re.compile(r"\.part[0-9]{4,}$")


def find(given: Sequence[Path]) -> list[Path]:
    """Return the recordings that paths, folders and globs name, each once, in their order.

    A folder that a run wrote is a recording; in any other folder all recordings below it count,
    but for those in hidden folders and in folders that a command like this one has written. A path
    that names nothing is returned unchanged; opening it raises.
    """
    return list(dict.fromkeys(chain.from_iterable(_found(path) for path in given)))


def names_one(given: Sequence[Path]) -> bool:
    """Return whether one recording is named by itself, not by a folder or a glob."""
    return len(given) == 1 and find(given) == list(given)


def _found(path: Path) -> list[Path]:
    if glob.has_magic(str(path)) and not path.exists():
        names = glob.glob(str(path), recursive=True)  # noqa: PTH207 - Path.glob wants relative ones
        matches = sorted(Path(name) for name in names)
        return list(chain.from_iterable(_found(match) for match in matches)) or [path]
    return list(_below(path)) or [path] if path.is_dir() else [path]


def _below(folder: Path) -> Iterator[Path]:
    """Give the folder where a run wrote it, else the recordings below it."""
    if parts(folder / RECORDING):
        yield folder
        return
    for child in sorted(folder.iterdir()):
        if child.name.startswith(".") or (child / ABOUT).is_file():
            continue
        if child.is_dir() and not child.is_symlink():
            yield from _below(child)
        elif child.is_file() and child.suffix.lower() in SUFFIXES:
            yield child.with_name(_LATER_PART.sub("", child.stem) + child.suffix)


def own_names(recordings: Sequence[Path]) -> dict[Path, str]:
    """Return a name for the output of each recording: its own name, or that of its run's folder.

    No two have the same, or the second would overwrite the output of the first.
    """
    names: dict[Path, str] = {}
    taken: set[str] = set()
    for given in recordings:
        path = given / RECORDING if given.is_dir() else given
        stem = path.resolve().parent.name if path.name == RECORDING else path.stem
        numbered = (f"{stem}-{number}" for number in count(2))
        names[given] = next(name for name in chain([stem], numbered) if name not in taken)
        taken.add(names[given])
    return names


def digest_of(given: Path) -> str | None:
    """Return a digest of all files that an answer rests on, None where one cannot be read.

    The recording with its parts, the file that names its columns, and the trial beside it.
    """
    path = given / RECORDING if given.is_dir() else given
    beside = (path.with_name(f"{path.stem}.columns.yaml"), path.with_name(TRIAL))
    digest = hashlib.blake2b(digest_size=16)
    try:
        for file in (*(parts(path) or [path]), *(one for one in beside if one.is_file())):
            with file.open("rb") as stream:
                digest.update(hashlib.file_digest(stream, "blake2b").digest())
    except OSError:
        return None
    return digest.hexdigest()


def refuse_itself(recording: Path, test: Path) -> None:
    """Raise RecordingError where a recording is to be the test of itself or of its copy."""
    digest = digest_of(recording)
    if digest is not None and digest == digest_of(test):
        raise RecordingError(
            f"{recording}: --test is the recording itself or a copy of it, so nothing is held out:"
            " give another one; `diagnose` without --test holds out parts of the recording"
        )
