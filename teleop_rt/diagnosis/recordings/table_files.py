"""Tables in CSV, MAT and NPZ files: columns of numbers by name."""

from __future__ import annotations

import codecs
import math
import os
import re
import struct
import sys
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from itertools import islice, pairwise
from pathlib import Path
from typing import IO, Any

import numpy as np
import scipy
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.errors import RecordingError
from teleop_rt.recording_memory import most_bytes, refuse_more

_UNREADABLE = (
    OSError, ValueError, TypeError, NotImplementedError, EOFError, MemoryError, zipfile.BadZipFile,
    zlib.error, struct.error, scipy.io.matlab.MatReadError, SyntaxError, tokenize.TokenError,
)  # fmt: skip
_NEXT_STEP = {
    ".csv": "a line that names the columns and then lines of numbers are needed, as text in UTF-8",
    ".mat": "save it as MATLAB's format 7 or older (`save -v7`), with plain arrays",
    ".npz": "save plain arrays of numbers with numpy.savez",
}
_LONGEST_REASON = 160
_LONGEST_PREAMBLE = 100  # lines; instruments write a screenful of settings at most
_LONGEST_LINE = 1 << 16
"""Characters that are read in search of the end of a line that names columns."""
_NUMBER_BYTES = 8
"""Of a number as it is held, whatever it takes in its file."""
_PIECE = 1 << 20
"""Bytes of a file, or of what is packed in it, that are looked at in one piece."""
_MAT_HEADER, _MAT_PACKED = 128, 15
_NUMERIC_KINDS = "fiu"
_NUMERIC_CLASSES = frozenset({"double", "single", "logical", "int8", "uint8", "int16", "uint16",
                              "int32", "uint32", "int64", "uint64"})  # fmt: skip
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
        reason = " ".join(str(error).split()) or "there is too little memory"
        if len(reason) > _LONGEST_REASON:  # one that lists every line that is wrong
            reason = f"{reason[:_LONGEST_REASON]} ..."
        raise RecordingError(
            f"{path}: cannot be read as {path.suffix}: {reason}; {_NEXT_STEP[path.suffix.lower()]}"
        ) from error


def _read_csv(path: Path) -> dict[str, Vector]:
    most = most_bytes()
    refuse_more(path, path.stat().st_size, most)
    _refuse_utf_16(path)
    _refuse_preamble(path)
    with path.open(encoding="utf-8-sig") as stream:
        header = stream.readline(_LONGEST_LINE).strip().lstrip("#").strip()
        first = stream.readline(_LONGEST_LINE).rstrip("\r\n")
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
    refuse_more(path, _NUMBER_BYTES * _fields(path, delimiter), most)
    commas = delimiter != "," and _has_decimal_commas(path)
    try:
        data = _loaded(path, delimiter, commas=commas)
    except ValueError:  # fields that are empty or no numbers: ten times slower
        with path.open(encoding="utf-8-sig") as stream:
            for number, line in enumerate(stream, 1):
                text = line.partition("#")[0].strip("\r\n")
                if number > 1 and text and (count := text.count(delimiter) + 1) != columns:
                    raise ValueError(f"line {number} has {count} fields, not {columns}") from None
        data = _loaded(path, delimiter, commas=commas, converters=_number_or_nan)
        _note_texts(path, names, delimiter, data)
    return {name: data[:, i] for i, name in enumerate(names)}


def _note_texts(path: Path, names: list[str], delimiter: str, data: NDArray[np.float64]) -> None:
    """Print the first cell whose text is no number, and how many there are: they count as missing.

    Empty cells, and those that say not-a-number, are no such text.
    """
    suspects = set((np.flatnonzero(np.isnan(data).any(axis=1))).tolist())
    with path.open(encoding="utf-8-sig") as stream:
        rows = (line for line in islice(stream, 1, None) if line.strip())
        found = [
            (row + 2, name, cell.strip())
            for row, line in enumerate(rows) if row in suspects
            for name, cell in zip(names, line.split(delimiter), strict=False)
            if cell.strip() and not _is_number(cell.replace(",", "."))
        ]  # fmt: skip
    if not found:
        return
    line, name, text = found[0]
    more = f", and {len(found) - 1} more such cells" if len(found) > 1 else ""
    print(
        f"{path}: line {line}, column {name!r}: {text[:40]!r} is no number{more}:"
        " counted as missing",
        file=sys.stderr,
    )


def _loaded(path: Path, delimiter: str, *, commas: bool, **how: Any) -> NDArray[np.float64]:
    """Return the numbers below the first line; what they take is known to fit."""
    how |= {"delimiter": delimiter, "skiprows": 1, "ndmin": 2, "encoding": "utf-8-sig"}
    if not commas:
        return np.loadtxt(path, **how)
    with path.open(encoding="utf-8-sig") as stream:
        return np.loadtxt((_DECIMAL_COMMA.sub(r"\1.\2", line) for line in stream), **how)


def _fields(path: Path, delimiter: str) -> int:
    """Return how many fields a file has at most."""
    with path.open("rb") as stream:
        pieces = iter(lambda: stream.read(_PIECE), b"")
        return 1 + sum(piece.count(delimiter.encode()) + piece.count(b"\n") for piece in pieces)


def _refuse_utf_16(path: Path) -> None:
    with path.open("rb") as stream:
        if stream.read(2) in {codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE}:
            raise ValueError("it is text in UTF-16: save it in UTF-8")


def _refuse_preamble(path: Path) -> None:
    """Raise ValueError where another line than the first is the last before the numbers.

    A line of units below the names has as many fields as they, a line of a preamble does not.
    """
    with path.open(encoding="utf-8-sig") as stream:
        begun = iter(lambda: stream.readline(_LONGEST_LINE), "")
        lines = [line.strip() for line in islice(begun, _LONGEST_PREAMBLE)]
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


def _has_decimal_commas(path: Path) -> bool:
    """Return whether commas mark decimals in a file whose columns no comma parts."""
    commas = points = False
    with path.open(encoding="utf-8-sig") as stream:
        for line in stream:
            commas = commas or _DECIMAL_COMMA.search(line) is not None
            points = points or _DECIMAL_POINT.search(line) is not None
    if commas and points:
        raise ValueError("numbers have both , and . for decimals: save it with one of them")
    return commas


def _number_or_nan(text: str) -> float:
    return float(text) if _is_number(text) else math.nan


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _read_mat(path: Path) -> dict[str, Vector]:
    most = most_bytes()
    with path.open("rb") as stream:
        for unpacked in _packed_sizes(stream, most):
            refuse_more(path, unpacked, most)
    arrays = [(name, shape) for name, shape, kind in scipy.io.whosmat(path)
              if kind in _NUMERIC_CLASSES]  # fmt: skip
    refuse_more(path, _NUMBER_BYTES * sum(math.prod(shape) for _, shape in arrays), most)
    return _arrays(scipy.io.loadmat(path, variable_names=[name for name, _ in arrays]))


def _packed_sizes(stream: IO[bytes], most: int) -> Iterator[int]:
    """Give to what size the packed elements of a MAT file unpack, all so far, up to `most`.

    Of formats 5 to 7 (MathWorks, "MAT-File Format"): 128 bytes of header, then elements with type
    and length; the packed ones have type 15. Others are as long as the file itself.
    """
    header = stream.read(_MAT_HEADER)
    order = {b"IM": "<", b"MI": ">"}.get(header[-2:])
    unpacked = 0
    while order is not None and len(tag := stream.read(8)) == 8:
        kind, left = struct.unpack(f"{order}II", tag)
        if kind != _MAT_PACKED:
            stream.seek(left, os.SEEK_CUR)
            continue
        packed = zlib.decompressobj()
        while left and unpacked <= most:
            piece = stream.read(min(left, _PIECE))
            if not piece:
                return
            left -= len(piece)
            while piece and unpacked <= most:
                unpacked += len(packed.decompress(piece, _PIECE))
                piece = packed.unconsumed_tail
        yield unpacked


def _read_npz(path: Path) -> dict[str, Vector]:
    """Read the arrays of an archive one after another, once its parts have stated their sizes."""
    if not zipfile.is_zipfile(path):
        raise ValueError("it is no archive of arrays")
    most = most_bytes()
    with zipfile.ZipFile(path) as parts:
        refuse_more(path, sum(part.file_size for part in parts.infolist()), most)
        numbers = sum(_numbers_in(parts, part) for part in parts.infolist())
    refuse_more(path, _NUMBER_BYTES * numbers, most)
    found: dict[str, Vector] = {}
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as archive:
        for name in archive.files:
            found |= _arrays({name: archive[name]})
    return found


def _numbers_in(parts: zipfile.ZipFile, part: zipfile.ZipInfo) -> int:
    """Return how many numbers a part declares; 0 where it is no array that is read."""
    readers = {(1, 0): np.lib.format.read_array_header_1_0,
               (2, 0): np.lib.format.read_array_header_2_0}  # fmt: skip
    with parts.open(part) as stream:
        if stream.read(len(np.lib.format.MAGIC_PREFIX)) != np.lib.format.MAGIC_PREFIX:
            return 0
        major, minor = stream.read(2)
        reader = readers.get((major, minor))
        if reader is None:  # version 3 names fields of structures, which are no columns
            return 0
        shape, _, kind = reader(stream)
    return math.prod(shape) if kind.kind in _NUMERIC_KINDS else 0


def _arrays(raw: Mapping[str, object]) -> dict[str, Vector]:
    """Return numeric arrays as columns; a matrix gives name[0], name[1], ..."""
    found: dict[str, Vector] = {}
    for name, value in raw.items():
        array = np.asarray(value)
        if array.dtype.kind not in _NUMERIC_KINDS or name.startswith("__"):
            continue
        squeezed = np.squeeze(array).astype(np.float64, copy=False)
        if squeezed.ndim <= 1:
            found[name] = np.atleast_1d(squeezed)
        elif squeezed.ndim == 2:
            for i in range(squeezed.shape[1]):
                found[f"{name}[{i}]"] = squeezed[:, i]
    return found
