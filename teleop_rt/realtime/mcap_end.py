"""The end of an MCAP file: where its summary lies, and whether its data are as written."""

from __future__ import annotations

import os
import struct
import zlib
from typing import IO

from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

RECORD_HEAD = struct.Struct("<BQ")
"""Opcode and bytes of a record, before its content."""
_FOOTER = struct.Struct("<BQQ")
"""The last record up to where the summary begins; two more numbers and the magic follow."""
_END_BYTES = _FOOTER.size + 8 + 4 + len(MCAP0_MAGIC)
_DATA_END = struct.Struct("<BQI")
"""The record before the summary: the checksum of all bytes before it, or 0."""
_BLOCK = 1 << 18
"""Bytes read at once for the checksum; a second-level cache holds them."""


def ends_whole(stream: IO[bytes]) -> bool:
    """Return whether a file has the end that only a writer that finished gives it."""
    length = len(MCAP0_MAGIC)
    stream.seek(-min(length, stream.seek(0, os.SEEK_END)), os.SEEK_END)
    return stream.read() == MCAP0_MAGIC


def summary_place(stream: IO[bytes]) -> tuple[int, int] | None:
    """Return where the summary begins and ends; None where the file was cut off or has none."""
    end = stream.seek(0, os.SEEK_END) - _END_BYTES
    if end < 0:
        return None
    stream.seek(end)
    footer = stream.read()
    opcode, _, begin = _FOOTER.unpack_from(footer)
    if opcode != Opcode.FOOTER or not footer.endswith(MCAP0_MAGIC) or not 0 < begin <= end:
        return None
    return begin, end


def data_checksum_holds(stream: IO[bytes]) -> bool | None:
    """Return whether the checksum of the data is right; None where the file has none.

    It covers the packed bytes of every chunk, of which there are a sixth of the unpacked ones that
    the checksums of the chunks cover.
    """
    place = summary_place(stream)
    end = place[0] - _DATA_END.size if place else -1
    if end < 0:
        return None
    stream.seek(end)
    opcode, _, written = _DATA_END.unpack(stream.read(_DATA_END.size))
    if opcode != Opcode.DATA_END or written == 0:
        return None
    stream.seek(0)
    checksum = 0
    while end > 0 and (block := stream.read(min(end, _BLOCK))):
        checksum = zlib.crc32(block, checksum)
        end -= len(block)
    return bool(checksum == written)
