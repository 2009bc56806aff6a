"""The content of a chunk of an MCAP file, unpacked with bounds and checked."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from io import BytesIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.records import Chunk
from mcap.stream_reader import get_chunk_data_stream

from teleop_rt.realtime.mcap_chunk import CHUNK

COUNT = struct.Struct("<Q")
"""The number of packed bytes, after the head of a chunk and its letters."""
LONGEST_CHUNK = 64 << 20
"""Bytes of an unpacked chunk; ours have a quarter of a megabyte, other writers' up to 4."""
_AS_WE_PACK = b"zstd"
CUT_OFF = (
    McapError, struct.error, zstandard.ZstdError, EOFError, ValueError, OverflowError, MemoryError,
    LookupError, RuntimeError,
)  # fmt: skip
"""Exceptions on reading a file that ends within a record, or contains impossible sizes."""


def unpack_chunk(
    content: bytes, decompressor: zstandard.ZstdDecompressor, *, verify: bool = True
) -> bytes:
    """Return the records of a chunk; an error where it cannot be unpacked whole.

    The size that a chunk states is believed only as far as its compression states the same:
    a megabyte of zstd may hold terabytes. As we pack it, this is done here, with one decompressor
    for all chunks, where the library makes one for each; other compressions are left to it. The
    checksum of a chunk is not verified again in a file whose own checksum holds.
    """
    *_, size, checksum, letters = CHUNK.unpack_from(content)
    if size > LONGEST_CHUNK:
        raise McapError(f"a chunk of {size >> 20} MB")
    packed_at = CHUNK.size + letters
    if content[CHUNK.size : packed_at] != _AS_WE_PACK:
        return _unpacked_otherwise(content)
    (packed,) = COUNT.unpack_from(content, packed_at)
    first = packed_at + COUNT.size
    if first + packed > len(content):
        raise EOFError
    data = memoryview(content)[first : first + packed]
    if zstandard.frame_content_size(data) not in (-1, size):  # -1 where the frame does not say
        raise McapError("a chunk unpacks to another size than it states")
    unpacked = decompressor.decompress(data, size)
    if len(unpacked) != size:
        raise McapError("a chunk unpacks to another size than it states")
    if verify and checksum not in (0, zlib.crc32(unpacked)):  # 0 by those who wrote none
        raise McapError("the checksum of a chunk is wrong")
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


def packed_end(content: bytes) -> int:
    """Return where the packed records end in the content of a chunk, by its own head."""
    *_, letters = CHUNK.unpack_from(content)
    (packed,) = COUNT.unpack_from(content, CHUNK.size + letters)
    return int(CHUNK.size + letters + COUNT.size + packed)
