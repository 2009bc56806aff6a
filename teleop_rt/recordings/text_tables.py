"""Tables of numbers in text, as instruments and spreadsheets write them.

The lines of numbers are found first, then the line of names above them, and a line of units below
the names; the lines before these are a preamble. Columns are parted by tabs, semicolons, commas or
blanks. Stamps of date and time become seconds.
"""

from __future__ import annotations

import codecs
import csv
import re
import sys
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.effect import Vector
from teleop_rt.recordings.cells import is_number, number_of
from teleop_rt.recordings.column_names import NEEDED, may_be
from teleop_rt.recordings.memory import most_bytes, refuse_more
from teleop_rt.recordings.units import are_units

_LONGEST_PREAMBLE = 200  # lines; instruments write a screenful or two of settings at most
_LONGEST_LINE = 1 << 16
"""Characters that are read in search of the end of a line."""
_ROWS_ALIKE = 5  # lines with numbers in the same columns: settings in a preamble come in fewer
_NUMBER_BYTES = 8
"""Of a number as it is held, whatever it takes in its file."""
_PIECE = 1 << 20
"""Bytes of a file that are looked at in one piece."""
_DELIMITERS = ("\t", ";", None, ",")
"""In the order in which they are tried; None: runs of blanks. A comma may also mark decimals."""
_COMMENT = "#"
_LABELS = {"channel", "channel name", "name", "signal", "unit", "units"}
"""Before each cell of a line of names or units, as in `Unit,"V",Unit,"V"` of a scope."""
_CELL_SHOWN = 40  # characters of a cell in a message
_HINT = "; if commas mark the decimals, separate the columns by semicolons"
_DECIMAL = re.compile(r"[-+]?\d*[.,]\d+(e[-+]?\d+)?", re.IGNORECASE)
_GROUPED = re.compile(r"[-+]?\d{1,3}((\.\d{3})+,|(,\d{3})+\.)\d+")
_WITH_UNIT = re.compile(r"[-+]?\d+[.,]?\d*(e[-+]?\d+)?\s*[^\W\d_]{1,3}", re.IGNORECASE)
_RULE = re.compile(r"[-=_|+\s]+")
_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
_WINDOWS = "cp1252"  # the encoding of spreadsheets in western Europe; only names have such letters


@dataclass(frozen=True)
class _Text:
    """Where the table of a file lies: `first` is the line (from 0) of its first numbers."""

    path: Path
    encoding: str
    delimiter: str | None
    names: list[str]
    first: int


class TableError(ValueError):
    """A table of text has a fault at a place that the message names."""


def read_text(path: Path) -> dict[str, Vector]:
    """Return the columns of a text file by name; one without names gives column1, column2, ...

    Raises ValueError where there is no table in it, RecordingError where it needs too much memory.
    """
    most = most_bytes()
    refuse_more(path, path.stat().st_size, most)
    text = _located(path, _encoding(path))
    refuse_more(path, _NUMBER_BYTES * _fields(text), most)
    try:  # numbers with points and nothing else
        data = np.loadtxt(path, delimiter=text.delimiter, skiprows=text.first, ndmin=2,
                          encoding=text.encoding)  # fmt: skip
    except ValueError:
        data = _by_cells(text)
    return {name: data[:, i] for i, name in enumerate(text.names)}


def _encoding(path: Path) -> str:
    """Return the encoding that a file's mark or its bytes show."""
    decoder, encoding = codecs.getincrementaldecoder("utf-8")(), "utf-8"
    with path.open("rb") as stream:
        pieces = iter(lambda: stream.read(_PIECE), b"")
        for place, piece in enumerate(pieces):
            if place == 0:
                for mark, marked in _MARKS.items():
                    if piece.startswith(mark):
                        return marked
            if encoding == "utf-8":
                try:
                    decoder.decode(piece)
                except UnicodeDecodeError:
                    encoding = _WINDOWS
            if encoding == _WINDOWS:
                _refuse_binary(piece, place * _PIECE)
    return encoding


def _refuse_binary(piece: bytes, at: int) -> None:
    """Raise ValueError where a piece of a file, which begins at a byte, is no text at all."""
    try:
        piece.decode(_WINDOWS)
    except UnicodeDecodeError as error:
        where = at + error.start
        raise ValueError(f"byte 0x{piece[error.start]:02x} at {where} belongs to no text") from None


def _located(path: Path, encoding: str) -> _Text:
    """Find the lines of numbers and the names above them."""
    with path.open(encoding=encoding) as stream:
        begun = iter(lambda: stream.readline(_LONGEST_LINE), "")
        lines = [line.rstrip("\r\n") for line in islice(begun, _LONGEST_PREAMBLE + _ROWS_ALIKE)]
    filled = [i for i, line in enumerate(lines) if line.strip() and not _RULE.fullmatch(line)]
    if not filled:
        raise ValueError("the file is empty")
    rows = [i for i in filled if not lines[i].lstrip().startswith(_COMMENT)]
    for place, first in enumerate(rows):
        for delimiter in _DELIMITERS:
            table = [_cells(lines[i], delimiter) for i in rows[place : place + _ROWS_ALIKE]]
            _refuse_grouped(table, first)
            if _are_numbers(table):
                columns = len(table[0])
                if place:
                    _refuse_other_count(lines[rows[place - 1]], delimiter, first, columns)
                above = [lines[i] for i in filled if i < first]
                names = _names_of(above, columns, delimiter)
                if len(above) > 1:
                    print(
                        f"{path}: numbers begin in line {first + 1}, columns: {', '.join(names)}",
                        file=sys.stderr,
                    )
                return _Text(path, encoding, delimiter, names, first)
    if rows and [i for i in rows if _is_row(lines[i])] == rows[-1:]:
        raise TableError(
            f"line {rows[-1] + 1} is the only row of numbers: was the recording cut off?"
        )
    if len(rows) == 1:
        raise TableError(f"no lines of numbers below line {rows[0] + 1}: was anything recorded?")
    if not rows:
        raise ValueError("no data")
    _refuse_units_in_cells(lines[rows[-1]], rows[-1])
    last = f"line {rows[-1] + 1}: {lines[rows[-1]].strip()[:_CELL_SHOWN]!r}"
    raise ValueError(f"no lines of numbers below each other found ({last})")


def _refuse_units_in_cells(line: str, place: int) -> None:
    """Raise TableError where the numbers of a line have units of their own behind them."""
    cells = (cell for delimiter in (";", ",") for cell in _cells(line, delimiter))
    found = next((cell for cell in cells if _WITH_UNIT.fullmatch(cell)), None)
    if found is not None:
        raise TableError(
            f"line {place + 1}: {found!r} is a number with a unit: leave the units out of the"
            " lines, and write them behind the names, as force [N]"
        )


def _cells(line: str, delimiter: str | None) -> list[str]:
    """Return the fields of a line, without quotation marks and blanks about them."""
    if delimiter is None:  # the unit of `x [mm]` is no column of its own
        return re.sub(r"\s+([\[(])", r"\1", line).split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _are_numbers(table: Sequence[Sequence[str]]) -> bool:
    """Return whether the lines have as many fields, and at least two columns of numbers."""
    if len(table) < 2 or len({len(cells) for cells in table}) > 1:
        return False
    full = sum(all(map(is_number, column)) for column in zip(*table, strict=True))
    return full >= 2


def _is_row(line: str) -> bool:
    """Return whether a line has two numbers or more, and nothing else."""
    parted = (_cells(line, delimiter) for delimiter in _DELIMITERS)
    return any(len(cells) > 1 and all(map(is_number, cells)) for cells in parted)


def _refuse_grouped(table: Sequence[Sequence[str]], first: int) -> None:
    """Raise TableError where every field is a number, and some have their thousands grouped."""
    cells = [cell for row in table for cell in row]
    if len(table) < 2 or len({len(row) for row in table}) > 1 or len(table[0]) < 2:
        return
    grouped = [cell for cell in cells if _GROUPED.fullmatch(cell)]
    if grouped and all(_GROUPED.fullmatch(cell) or is_number(cell) for cell in cells):
        raise TableError(
            f"line {first + 1}: {grouped[0]!r} has its thousands grouped: export the table without"
            " marks of thousands"
        )


def _refuse_other_count(line: str, delimiter: str | None, first: int, columns: int) -> None:
    """Raise ValueError where the line above the first numbers has another number of fields."""
    cells = _cells(line, delimiter)
    if delimiter is None or len(cells) < 2 or _is_name_of(cells, columns):
        return
    hint = _HINT if delimiter == "," else ""
    if all(map(is_number, cells)):
        raise TableError(f"line {first + 1} has {columns} fields, not {len(cells)}{hint}")
    if not any(map(is_number, cells)):
        raise TableError(f"{len(cells)} names for {columns} columns{hint}")


def _is_name_of(cells: Sequence[str], columns: int) -> bool:
    """Return whether cells can be names: one for each column, the last may have none."""
    return columns - 1 <= len(cells) <= columns and not any(map(is_number, cells))


def _names_of(above: Sequence[str], columns: int, delimiter: str | None) -> list[str]:
    """Return the names in the last lines above the numbers, with units from a line of their own."""
    rows = [_cells(line.lstrip("#% ").rstrip(delimiter), delimiter) for line in above[-2:]]
    full = [row + [""] * (columns - len(row)) if _is_name_of(row, columns) else [] for row in rows]
    names, below = ([[], [], *full])[-2:]
    labels = {row[0].lower() for row in (names, below) if _is_labelled(row)}
    names, below = (_unlabelled(row) for row in (names, below))
    if names and (are_units(below) or labels & {"unit", "units"}):
        units = [cell.strip("[]()") for cell in below]
        below = [f"{name} [{unit}]" if unit else name
                 for name, unit in zip(names, units, strict=True)]  # fmt: skip
    named = [name or f"column{i + 1}" for i, name in enumerate(below or [""] * columns)]
    return [f"{name} (column {i + 1})" if named.count(name) > 1 else name
            for i, name in enumerate(named)]  # fmt: skip


def _is_labelled(row: Sequence[str]) -> bool:
    """Return whether each second cell labels the cell after it, as a name or as a unit."""
    return len(row) > 1 and len(set(row[::2])) == 1 and row[0].lower() in _LABELS


def _unlabelled(row: list[str]) -> list[str]:
    """Return a row of names or units with its labels empty."""
    return ["" if i % 2 == 0 else cell for i, cell in enumerate(row)] if _is_labelled(row) else row


def _fields(text: _Text) -> int:
    """Return how many fields a file has at most."""
    mark = (text.delimiter or " ").encode()
    with text.path.open("rb") as stream:
        pieces = iter(lambda: stream.read(_PIECE), b"")
        return 1 + sum(piece.count(mark) + piece.count(b"\n") for piece in pieces)


def _by_cells(text: _Text) -> NDArray[np.float64]:
    """Return the numbers of a table with empty, quoted or other cells: ten times slower.

    The first cell that is a text and no number is printed, and how many there are: they count as
    missing. Columns of texts alone are not, and lines that repeat the names are left out, as is a
    last line that a logger which ended could not complete. Raises ValueError naming the first line
    with another number of fields, and where both marks of decimals occur.
    """
    numbers, texts, marks = array("d"), [], set()
    again = 0
    with text.path.open(encoding=text.encoding) as stream:
        for number, line in enumerate(islice(stream, text.first, None), text.first + 1):
            row = line.partition(_COMMENT)[0].strip("\r\n")
            if not row.strip():
                continue
            cells = _cells(row, text.delimiter)
            if len(cells) < len(text.names) and not line.endswith("\n"):
                print(f"{text.path}: line {number}, the last one, is cut off, and left out",
                      file=sys.stderr)  # fmt: skip
                break
            if len(cells) != len(text.names):
                raise TableError(
                    f"line {number} has {len(cells)} fields, not {len(text.names)}: complete it,"
                    " or remove it"
                )
            if _are_names(cells, text.names):
                again = again or number
                continue
            for name, cell in zip(text.names, cells, strict=True):
                numbers.append(number_of(cell))
                if cell and not is_number(cell):
                    texts.append((number, name, cell[:_CELL_SHOWN]))
                elif _DECIMAL.fullmatch(cell):
                    marks.add("," in cell)
            if len(marks) > 1:
                raise TableError("numbers have both , and . for decimals: save it with one of them")
    if again:
        print(f"{text.path}: line {again} names the columns again", file=sys.stderr)
    table = np.frombuffer(numbers).reshape(-1, len(text.names))
    words = {name for name, row in zip(text.names, table.T, strict=True)
             if np.isnan(row).all() and not any(may_be(name, role) for role in NEEDED)}  # fmt: skip
    _note_texts(text.path, [found for found in texts if found[1] not in words])
    return table


def _are_names(cells: Sequence[str], names: Sequence[str]) -> bool:
    """Return whether a line has the names of the columns, with or without their units."""
    return all(cell and cell in (name, name.rpartition(" [")[0])
               for cell, name in zip(cells, names, strict=True))  # fmt: skip


def _note_texts(path: Path, texts: Sequence[tuple[int, str, str]]) -> None:
    """Print the first of the cells that are no numbers."""
    if texts:
        line, name, cell = texts[0]
        more = f", and {len(texts) - 1} more such cells" if len(texts) > 1 else ""
        print(
            f"{path}: line {line}, column {name!r}: {cell!r} is no number{more}:"
            " counted as missing",
            file=sys.stderr,
        )
