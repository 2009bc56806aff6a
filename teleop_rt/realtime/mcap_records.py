"""Walk through the records of an MCAP file, quickly: an hour of a trial is ten million messages.

The library reads a message field by field, forty microseconds each; here its header is unpacked at
once. All other records are left to the library.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator
from io import BytesIO
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

Record = Schema | Channel | Message | Metadata
_HEAD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_A_MESSAGE = int(Opcode.MESSAGE)
_PLAIN: dict[int, Callable[[ReadDataStream], Record]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
}


def records(stream: IO[bytes]) -> Iterator[Record]:
    """Give schemas, channels, messages and metadata in the order of the file, up to its index.

    Raises EOFError where the file was cut off, and what the library raises for a broken record.
    """
    size = os.fstat(stream.fileno()).st_size
    stream.seek(len(MCAP0_MAGIC))
    while True:
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            raise EOFError
        opcode, length = _HEAD.unpack(head)
        if opcode == Opcode.DATA_END:
            return
        if stream.tell() + length > size:
            raise EOFError
        if opcode in _PLAIN or opcode in {Opcode.MESSAGE, Opcode.CHUNK}:
            content = stream.read(length)
            yield from _in_chunk(content) if opcode == Opcode.CHUNK else [_one(opcode, content)]
        else:
            stream.seek(length, os.SEEK_CUR)


def _in_chunk(content: bytes) -> Iterator[Record]:
    """Give the records of a chunk; none of it where it cannot be unpacked whole."""
    opened, size = get_chunk_data_stream(Chunk.read(ReadDataStream(BytesIO(content))))
    data = opened.read(size)
    at = 0
    while at < size:
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + length > size:
            raise EOFError
        if opcode == _A_MESSAGE:
            channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(data, at)
            text = data[at + _MESSAGE.size : at + length]
            yield Message(channel, log_time, text, publish_time, sequence)
        elif opcode in _PLAIN:
            yield _one(opcode, data[at : at + length])
        at += length


def _one(opcode: int, content: bytes) -> Record:
    if opcode == Opcode.MESSAGE:
        channel, sequence, log_time, publish_time = _MESSAGE.unpack_from(content)
        return Message(channel, log_time, content[_MESSAGE.size :], publish_time, sequence)
    return _PLAIN[opcode](ReadDataStream(BytesIO(content)))
