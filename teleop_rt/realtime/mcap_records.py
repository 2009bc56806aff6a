"""Walk through the records of an MCAP file, quickly: an hour of a trial is ten million messages.

The library reads a message field by field, forty microseconds each; here messages are only found,
and cut out where somebody wants them. All other records are left to the library.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import IO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

Other = Schema | Channel | Metadata
Record = Other | Message
Place = tuple[int, int, int]
"""Where a message lies in its chunk: (begin of its text, end, sequence)."""
Places = dict[int, list[Place]]
"""The same by channel."""
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_HEADS = struct.Struct("<BQHI")
"""What every record begins with, and of a message channel and sequence too."""
_CHECKSUM = struct.Struct("<I")
_TIMES = struct.Struct("<QQ")
"""What a chunk begins with: the stamps [ns] of its first message and of its last."""
_A_MESSAGE = int(Opcode.MESSAGE)
_PLAIN: dict[int, Callable[[ReadDataStream], Other]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
}
CUT_OFF = (
    McapError, struct.error, zstandard.ZstdError, EOFError, ValueError, OverflowError, MemoryError,
    LookupError,
)  # fmt: skip
"""What reading raises where a file ends in the middle of a record, or says sizes that are none."""


@dataclass(slots=True)
class Messages:
    """Messages that follow one another, not yet cut out of `data`: the places by channel."""

    data: bytes
    places: Places

    def cut_out(self) -> Iterator[Message]:
        """Give each message whole, in the order of the file."""
        of_all = [(*place, channel) for channel, some in self.places.items() for place in some]
        for begin, end, sequence, channel in sorted(of_all):
            *_, log_time, publish_time = _MESSAGE.unpack_from(self.data, begin - _MESSAGE.size)
            yield Message(channel, log_time, self.data[begin:end], publish_time, sequence)


def blocks(stream: IO[bytes], from_ns: float = 0.0) -> Iterator[Other | Messages]:
    """Give schemas, channels, messages and metadata in the order of the file, up to its index.

    Chunks whose messages are all stamped before `from_ns` are left out, with the channels that
    they declare. Raises EOFError where the file was cut off, and what the library raises for a
    broken record or a checksum, of a chunk or of all, that is wrong.
    """
    size = os.fstat(stream.fileno()).st_size
    stream.seek(0)
    checksum = zlib.crc32(stream.read(len(MCAP0_MAGIC)))
    while True:
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise EOFError
        opcode, length = _HEAD.unpack(head)
        if stream.tell() + length > size:
            raise EOFError
        content = stream.read(length)
        if opcode == Opcode.DATA_END:
            (written,) = _CHECKSUM.unpack(content)
            if written not in (0, checksum):  # 0 by those who wrote none
                raise McapError("the checksum of the file is wrong")
            return
        checksum = zlib.crc32(content, zlib.crc32(head, checksum))
        if opcode == Opcode.CHUNK and _TIMES.unpack_from(content)[1] >= from_ns:
            yield from _walk(_unpacked(content))
        elif opcode in _PLAIN or opcode == Opcode.MESSAGE:
            yield from _walk(head + content)


def ends_whole(stream: IO[bytes]) -> bool:
    """Return whether a file has the end that only a writer that finished gives it."""
    length = len(MCAP0_MAGIC)
    stream.seek(-min(length, stream.seek(0, os.SEEK_END)), os.SEEK_END)
    return stream.read() == MCAP0_MAGIC


def _unpacked(content: bytes) -> bytes:
    """Return the records of a chunk; an error where it cannot be unpacked whole."""
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    opened, size = get_chunk_data_stream(chunk, validate_crc=True)
    return opened.read(size)


def _walk(data: bytes) -> Iterator[Other | Messages]:
    """Give the records of `data`, messages that follow one another at once."""
    at, size = 0, len(data)
    places: defaultdict[int, list[Place]] = defaultdict(list)
    text, text_of_head = _HEAD.size + _MESSAGE.size, _HEADS.size
    while at + text_of_head <= size:
        opcode, length, channel, sequence = _HEADS.unpack_from(data, at)
        end = at + _HEAD.size + length
        if end > size:
            break
        if opcode == _A_MESSAGE:
            places[channel].append((at + text, end, sequence))
        elif opcode in _PLAIN:
            if places:
                yield Messages(data, places)
                places = defaultdict(list)
            yield _PLAIN[opcode](ReadDataStream(BytesIO(data[at + _HEAD.size : end])))
        at = end
    if places:
        yield Messages(data, places)
    if at < size:
        raise EOFError
