"""Unpack the chunks of an MCAP file, those of a long one ahead of who reads their messages."""

from __future__ import annotations

import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

CHUNK = struct.Struct("<QQQII")
"""The head of a chunk: the stamps [ns] of its first message and of its last, the bytes of its
records and their checksum, and the letters of how they are packed, which follow."""
LONGEST_CHUNK = 64 << 20
"""Bytes of an unpacked chunk; ours have a quarter of a megabyte, other writers' up to 4."""
CUT_OFF = (
    McapError, struct.error, zstandard.ZstdError, EOFError, ValueError, OverflowError, MemoryError,
    LookupError, RuntimeError,
)  # fmt: skip
"""Exceptions on reading a file that ends within a record, or contains impossible sizes."""
_COUNT = struct.Struct("<Q")
_AS_WE_PACK = b"zstd"
_AHEAD_BYTES = 2 << 20
"""Unpacked bytes that may wait: eight of our chunks, or one of another writer's."""


@dataclass(slots=True)
class Raw:
    """A record as it lies in the file, a chunk with its message indices."""

    opcode: int
    head: bytes
    content: bytes
    indices: list[bytes]
    end: int
    """Where it ends in the file, its indices included."""

    @property
    def size(self) -> int:
        """The bytes that a chunk says to unpack to; 0 of another record."""
        return int(CHUNK.unpack_from(self.content)[2]) if self.opcode == Opcode.CHUNK else 0


Give = Callable[[], bytes]
"""Gives the records of a chunk, or raises one of CUT_OFF; nothing of another record."""


def unpacked_here(records: Iterator[Raw]) -> Iterator[tuple[Raw, Give]]:
    """Give each record; a chunk is unpacked when it is asked for its own."""
    decompressor = zstandard.ZstdDecompressor()
    for record in records:
        yield record, partial(_checked, record, partial(_unpack, record, decompressor))


def unpacked_ahead(records: Iterator[Raw]) -> Iterator[tuple[Raw, Give]]:
    """Give each record; meanwhile a thread unpacks the chunks that follow.

    Where `records` raises one of CUT_OFF, those before it are given first. The thread only
    unpacks: it is given Python's lock while the other one computes the checksum of a chunk.
    """
    decompressor = zstandard.ZstdDecompressor()  # of one thread, which runs one task at a time
    waiting: deque[tuple[Raw, Give]] = deque()
    held, failure, more = 0, None, True
    with ThreadPoolExecutor(max_workers=1) as pool:
        while more or waiting:
            while more and (not waiting or held < _AHEAD_BYTES):
                try:
                    record = next(records)
                except StopIteration:
                    more = False
                except CUT_OFF as error:
                    failure, more = error, False
                else:
                    waiting.append((record, pool.submit(_unpack, record, decompressor).result))
                    held += record.size
            if waiting:
                record, unpacked = waiting.popleft()
                held -= record.size
                yield record, partial(_checked, record, unpacked)
    if failure is not None:
        raise failure


def _unpack(record: Raw, decompressor: zstandard.ZstdDecompressor) -> bytes:
    is_chunk = record.opcode == Opcode.CHUNK
    return unpack_chunk(record.content, decompressor) if is_chunk else b""


def _checked(record: Raw, unpacked: Give) -> bytes:
    """Return the records of a chunk. Raises McapError where their checksum is wrong."""
    data = unpacked()
    *_, written, _ = CHUNK.unpack_from(record.content)
    if written not in (0, zlib.crc32(data)):  # 0 by those who wrote none
        raise McapError("the checksum of a chunk is wrong")
    return data


def unpack_chunk(content: bytes, decompressor: zstandard.ZstdDecompressor) -> bytes:
    """Return the records of a chunk; an error where it cannot be unpacked whole.

    The size that a chunk states is believed only as far as its compression states the same:
    a megabyte of zstd may hold terabytes. As we pack it, this is done here, with one decompressor
    for all chunks, where the library makes one for each; other compressions are left to it.
    """
    *_, size, _, letters = CHUNK.unpack_from(content)
    if size > LONGEST_CHUNK:
        raise McapError(f"a chunk of {size >> 20} MB")
    packed_at = CHUNK.size + letters
    if content[CHUNK.size : packed_at] != _AS_WE_PACK:
        return _unpacked_otherwise(content)
    (packed,) = _COUNT.unpack_from(content, packed_at)
    first = packed_at + _COUNT.size
    if first + packed > len(content):
        raise EOFError
    data = memoryview(content)[first : first + packed]
    if zstandard.frame_content_size(data) not in (-1, size):  # -1 where the frame does not say
        raise McapError("a chunk unpacks to another size than it states")
    unpacked = decompressor.decompress(data, size)
    if len(unpacked) != size:
        raise McapError("a chunk unpacks to another size than it states")
    return unpacked


def _unpacked_otherwise(content: bytes) -> bytes:
    """Return the records of a chunk that is packed by lz4, or not at all."""
    chunk = Chunk.read(ReadDataStream(BytesIO(content)))
    if chunk.compression == "lz4":
        unpacking = lz4.frame.LZ4FrameDecompressor()
        data = unpacking.decompress(chunk.data, max_length=chunk.uncompressed_size + 1)
        chunk = replace(chunk, compression="", data=data)
    opened, size = get_chunk_data_stream(chunk, validate_crc=True)
    if size != chunk.uncompressed_size:
        raise McapError("a chunk unpacks to another size than it states")
    return opened.read(size)
