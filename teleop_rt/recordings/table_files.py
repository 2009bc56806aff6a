"""Tables in text, MAT and NPZ files: columns of numbers by name."""

from __future__ import annotations

import math
import os
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

import numpy as np

from teleop_rt.contact.effect import Vector
from teleop_rt.errors import RecordingError
from teleop_rt.recordings.memory import most_bytes, refuse_more
from teleop_rt.recordings.text_tables import TableError, read_text

TEXT = (".csv", ".txt", ".tsv", ".dat", ".asc", ".lvm")
_UNREADABLE = (
    OSError, ValueError, TypeError, NotImplementedError, EOFError, MemoryError, zipfile.BadZipFile,
    zlib.error, struct.error, SyntaxError, tokenize.TokenError,
)  # fmt: skip
_NEXT_STEP = {
    **dict.fromkeys(
        TEXT,
        "text in UTF-8 is needed: a line that names the columns, lines of as many numbers below it",
    ),
    ".mat": "save it as MATLAB's format 7 or older (`save -v7`), with plain arrays",
    ".npz": "save plain arrays of numbers with numpy.savez",
}
_LONGEST_REASON = 160  # characters of a library's message; numpy's may list a thousand lines
_NUMBER_BYTES = 8
"""Of a number as it is held, whatever it takes in its file."""
_PIECE = 1 << 20
"""Bytes of a file, or of its unpacked contents, that are searched in one piece."""
_MAT_HEADER, _MAT_PACKED = 128, 15  # bytes, and the type of an element; see `_packed_sizes`
_NUMERIC_KINDS = "fiu"
_NUMERIC_CLASSES = frozenset({"double", "single", "logical", "int8", "uint8", "int16", "uint16",
                              "int32", "uint32", "int64", "uint64"})  # fmt: skip


def read_table(path: Path) -> dict[str, Vector]:
    """Return the columns of a file by name. Raises RecordingError."""
    readers = {**dict.fromkeys(TEXT, read_text), ".mat": _read_mat, ".npz": _read_npz}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise RecordingError(
            f"{path}: unknown kind of file; one of .mcap, {', '.join(readers)}: export it as .csv"
        )
    if not path.is_file():
        raise RecordingError(f"{path}: no such file: check the path")
    try:
        return reader(path)
    except _UNREADABLE as error:
        reason = " ".join(str(error).split()) or "there is too little memory"
        if len(reason) > _LONGEST_REASON:  # one that lists every line that is wrong
            reason = f"{reason[:_LONGEST_REASON]} ..."
        next_step = "" if isinstance(error, TableError) else f"; {_NEXT_STEP[path.suffix.lower()]}"
        raise RecordingError(
            f"{path}: cannot be read as {path.suffix}: {reason}{next_step}"
        ) from error


def _read_mat(path: Path) -> dict[str, Vector]:
    most = most_bytes()
    with path.open("rb") as stream:
        for unpacked in _packed_sizes(stream, most):
            refuse_more(path, unpacked, most)
    from scipy.io import loadmat, matlab, whosmat  # noqa: PLC0415 - takes longer than other files

    try:
        held = whosmat(path)
        arrays = [(name, shape) for name, shape, kind in held if kind in _NUMERIC_CLASSES]
        structs = [name for name, shape, kind in held if kind == "struct" and shape == (1, 1)]
        refuse_more(path, _NUMBER_BYTES * sum(math.prod(shape) for _, shape in arrays), most)
        read = loadmat(path, variable_names=[name for name, _ in arrays] + structs)
        fields = {f"{name}.{field}": read[name][0, 0][field]
                  for name in structs for field in read[name].dtype.names or ()}  # fmt: skip
        refuse_more(path, _NUMBER_BYTES * sum(value.size for value in fields.values()), most)
        return _arrays(read | fields)
    except matlab.MatReadError as error:
        raise TableError(str(error)) from error


def _packed_sizes(stream: IO[bytes], most: int) -> Iterator[int]:
    """Yield the total size [bytes] of the unpacked elements of a MAT file so far, up to `most`.

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
