"""Tables in CSV, MAT and NPZ files: columns of numbers by name."""

from __future__ import annotations

import codecs
import re
import tokenize
import zipfile
import zlib
from collections.abc import Mapping
from itertools import islice, pairwise
from pathlib import Path

import numpy as np
import scipy

from teleop_rt.contact.effect import Vector
from teleop_rt.errors import RecordingError

_UNREADABLE = (
    OSError, ValueError, TypeError, NotImplementedError, EOFError, MemoryError, zipfile.BadZipFile,
    zlib.error, scipy.io.matlab.MatReadError, SyntaxError, tokenize.TokenError,
)  # fmt: skip
_NEXT_STEP = {
    ".csv": "a line that names the columns and then lines of numbers are needed, as text in UTF-8",
    ".mat": "save it as MATLAB's format 7 or older (`save -v7`), with plain arrays",
    ".npz": "save plain arrays of numbers with numpy.savez",
}
_LONGEST_REASON = 160
_LONGEST_PREAMBLE = 100  # lines; instruments write a screenful of settings at most
_MOST_BYTES = 4 << 30
"""Of an archive of arrays: a day at 1 kHz has 2 GB."""
_NUMBER = r"(?<![^;\t\n ])([-+]?\d*){}(\d+(?:[eE][-+]?\d+)?)(?![^;\t\n ])"
_DECIMAL_COMMA, _DECIMAL_POINT = (re.compile(_NUMBER.format(mark)) for mark in (",", r"\."))


def read_table(path: Path) -> dict[str, Vector]:
    """Return the columns of a file by name. Raises RecordingError."""
    readers = {".csv": _read_csv, ".mat": _read_mat, ".npz": _read_npz}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(f"{path}: unknown kind of file; one of .mcap, {', '.join(readers)}")
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    try:
        return reader(path)
    except _UNREADABLE as error:
        reason = " ".join(str(error).split())
        if len(reason) > _LONGEST_REASON:  # one that lists every line that is wrong
            reason = f"{reason[:_LONGEST_REASON]} ..."
        raise RecordingError(
            f"{path}: cannot be read as {path.suffix}: {reason}; {_NEXT_STEP[path.suffix.lower()]}"
        ) from error


def _read_csv(path: Path) -> dict[str, Vector]:
    _refuse_utf_16(path)
    _refuse_preamble(path)
    with path.open(encoding="utf-8-sig") as stream:
        header = stream.readline().strip().lstrip("#").strip()
        first = stream.readline().rstrip("\r\n")
        if not first.strip():
            raise ValueError("no data" if header else "the file is empty")
    delimiter = max(",;\t", key=header.count)
    names = [name.strip() for name in header.split(delimiter)]
    if any(_is_number(name) for name in names):
        raise ValueError("the first line must name the columns")
    if (columns := len(first.split(delimiter))) != len(names):
        hint = (
            "; if commas mark the decimals, separate the columns by ;" if delimiter == "," else ""
        )
        raise ValueError(f"{len(names)} names for {columns} columns{hint}")
    source = path if delimiter == "," else _with_points(path)
    try:
        data = np.loadtxt(source, delimiter=delimiter, skiprows=1, ndmin=2)
    except ValueError:
        # Fields are empty or no numbers: ten times slower, but it reads them as not-a-number.
        data = np.genfromtxt(source, delimiter=delimiter, skip_header=1, ndmin=2)
    return {name: data[:, i] for i, name in enumerate(names)}


def _refuse_utf_16(path: Path) -> None:
    with path.open("rb") as stream:
        if stream.read(2) in {codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE}:
            raise ValueError("it is text in UTF-16: save it in UTF-8")


def _refuse_preamble(path: Path) -> None:
    """Raise ValueError where another line than the first is the last before the numbers.

    A line of units below the names has as many fields as they, a line of a preamble does not.
    """
    with path.open(encoding="utf-8-sig") as stream:
        lines = [line.strip() for line in islice(stream, _LONGEST_PREAMBLE)]
    for number, (names, values) in enumerate(pairwise(lines), 1):
        delimiter = max(",;\t", key=names.count)
        fields, cells = names.split(delimiter), values.split(delimiter)
        point = "," if delimiter == "," else "."
        if len(fields) < 2 or len(cells) != len(fields) or any(map(_is_number, fields)):
            continue
        if not all(_is_number(cell.replace(",", point)) for cell in cells):
            continue
        if number == 2 and len(lines[0].split(delimiter)) == len(fields) and all(fields):
            raise ValueError(
                f"line 2 holds no numbers ({names[:60]}): remove it; units stand in the names of"
                " the columns, as x [mm]"
            )
        if len(lines[0].split(delimiter)) != len(fields):
            raise ValueError(
                f"line {number} looks like the one that names the columns ({names[:60]}): remove"
                " the lines before it"
            )
        return


def _with_points(path: Path) -> Path | list[str]:
    """Return a file whose columns no comma parts: its lines, where commas mark its decimals."""
    text = path.read_text(encoding="utf-8-sig")
    if not _DECIMAL_COMMA.search(text):
        return path
    if _DECIMAL_POINT.search(text):
        raise ValueError("numbers have both , and . for decimals: save it with one of them")
    return _DECIMAL_COMMA.sub(r"\1.\2", text).splitlines()


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_mat(path: Path) -> dict[str, Vector]:
    return _arrays({k: v for k, v in scipy.io.loadmat(path).items() if not k.startswith("__")})


def _read_npz(path: Path) -> dict[str, Vector]:
    if not zipfile.is_zipfile(path):
        raise ValueError("it is no archive of arrays")
    with zipfile.ZipFile(path) as parts:
        size = sum(part.file_size for part in parts.infolist())
    if size > _MOST_BYTES:
        raise ValueError(f"it unpacks to {size >> 20} MB, more than {_MOST_BYTES >> 20}")
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        return _arrays(dict(archive))


def _arrays(raw: Mapping[str, object]) -> dict[str, Vector]:
    """Return numeric arrays as columns; a matrix gives name[0], name[1], ..."""
    found: dict[str, Vector] = {}
    for name, value in raw.items():
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            continue
        squeezed = np.squeeze(array).astype(np.float64)
        if squeezed.ndim <= 1:
            found[name] = np.atleast_1d(squeezed)
        elif squeezed.ndim == 2:
            for i in range(squeezed.shape[1]):
                found[f"{name}[{i}]"] = squeezed[:, i]
    return found
