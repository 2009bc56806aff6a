"""Write an MCAP file of many small messages: the bytes of the library's writer in half of its time.

The library makes an object of each message and writes it field by field; here the head of a message
is packed at once, and the rest of a file is left to the library's records.
"""

from __future__ import annotations

import struct
import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from typing import Protocol

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC

COMPRESSION = "zstd"
_MESSAGE = struct.Struct("<BQHIQQ")
"""Head of a message: opcode, bytes that follow, channel, sequence, two times [ns]."""
_head, _A_MESSAGE = _MESSAGE.pack, int(Opcode.MESSAGE)
_AFTER_LENGTH = _MESSAGE.size - struct.calcsize("<BQ")
_INDEX = struct.Struct("<BQHI")
"""Head of a chunk's index of one channel: opcode, bytes that follow, channel, bytes of pairs."""
_AFTER_INDEX_LENGTH = _INDEX.size - struct.calcsize("<BQ")
_FOOTER = struct.Struct("<BQQQ")
_FOOTER_BYTES = 20


class _Stream(Protocol):
    def write(self, data: bytes) -> int:
        """Take bytes."""

    def tell(self) -> int:
        """Return how many were taken."""


class _OpenChunk:
    """Records of a chunk that is not full yet, and where its messages lie, by channel."""

    def __init__(self) -> None:
        self.pieces: list[bytes] = []
        self.size = 0
        self.places: dict[int, list[tuple[int, int]]] = {}

    def place(self, channel_id: int, stamp_ns: int) -> None:
        """Note that the next record is a message of this channel."""
        self.places.setdefault(channel_id, []).append((stamp_ns, self.size))

    def add(self, data: bytes) -> None:
        """Add a record."""
        self.pieces.append(data)
        self.size += len(data)

    @property
    def times(self) -> tuple[int, int]:
        """The first and the last time of a message [ns]."""
        stamps = [pair[0] for pairs in self.places.values() for pair in pairs]
        return min(stamps), max(0, *stamps)


class ChunkedWriter:
    """A file of chunks with schemas, channels and messages; then index, statistics, footer."""

    def __init__(self, stream: _Stream, chunk_bytes: int, library: str) -> None:
        """Begin the file; a chunk ends with the message by which it exceeds `chunk_bytes`."""
        self._stream = stream
        self._chunk_bytes = chunk_bytes
        self._chunk = _OpenChunk()
        self._checksum = 0
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._chunks: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._counts: defaultdict[int, int] = defaultdict(int)
        self._write(MCAP0_MAGIC)
        self._write(_record(Header("", library)))

    def add_metadata(self, name: str, content: Mapping[str, str]) -> None:
        """Write a named record of text."""
        data, offset = _record(Metadata(name=name, metadata=dict(content))), self._stream.tell()
        self._metadata.append(MetadataIndex(offset=offset, length=len(data), name=name))
        self._write(data)

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Declare a schema and return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._chunk.add(_record(schema))
        return schema.id

    def register_channel(self, topic: str, encoding: str, schema_id: int) -> int:
        """Declare a topic and return its number."""
        channel = Channel(len(self._channels) + 1, topic, encoding, {}, schema_id)
        self._channels.append(channel)
        self._chunk.add(_record(channel))
        return channel.id

    def add_messages(self, channel_id: int, messages: Iterable[tuple[int, bytes, int]]) -> None:
        """Add messages of a channel: time [ns], text and number of each."""
        count = 0
        for stamp_ns, text, number in messages:
            chunk, size = self._chunk, len(text) + _AFTER_LENGTH
            chunk.place(channel_id, stamp_ns)
            chunk.add(_head(_A_MESSAGE, size, channel_id, number, stamp_ns, stamp_ns) + text)
            count += 1
            if chunk.size > self._chunk_bytes:
                self._end_chunk()
        if count:
            self._counts[channel_id] += count

    def flush(self) -> None:
        """End the chunk that is open, if it has a message."""
        if self._chunk.places:
            self._end_chunk()

    def finish(self) -> None:
        """Write index, statistics and footer."""
        self.flush()
        self._write(_record(DataEnd(self._checksum)))
        begins = self._stream.tell()
        summary, offsets = b"", []
        for opcode, records in self._summary().items():
            group = b"".join(map(_record, records))
            offsets.append(SummaryOffset(opcode, begins + len(summary), len(group)))
            summary += group
        offsets_begin = begins + len(summary)
        summary += b"".join(map(_record, offsets))
        footer = _FOOTER.pack(Opcode.FOOTER, _FOOTER_BYTES, begins, offsets_begin)
        checksum = zlib.crc32(footer, zlib.crc32(summary))
        self._stream.write(summary)
        self._stream.write(_record(Footer(begins, offsets_begin, checksum)))
        self._stream.write(MCAP0_MAGIC)

    def _summary(self) -> dict[Opcode, list[_Record]]:
        """Return the records of the summary, by group, in the library's order."""
        return {
            Opcode.SCHEMA: [*self._schemas],
            Opcode.CHANNEL: [*self._channels],
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: [*self._chunks],
            Opcode.ATTACHMENT_INDEX: [],
            Opcode.METADATA_INDEX: [*self._metadata],
        }

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunks),
            message_count=sum(self._counts.values()),
            metadata_count=len(self._metadata),
            message_start_time=min((one.message_start_time for one in self._chunks), default=0),
            message_end_time=max((one.message_end_time for one in self._chunks), default=0),
            schema_count=len(self._schemas),
        )

    def _end_chunk(self) -> None:
        """Write the open chunk and its indexes, and open the next one."""
        ended, self._chunk = self._chunk, _OpenChunk()
        records = b"".join(ended.pieces)
        packed = zstandard.compress(records)
        starts, ends = ended.times
        checksum, begins = zlib.crc32(records), self._stream.tell()
        length = self._write(
            _record(Chunk(COMPRESSION, packed, ends, starts, checksum, len(records)))
        )
        index, indexes_begin, offsets = b"", self._stream.tell(), {}
        for channel_id, places in ended.places.items():
            offsets[channel_id] = indexes_begin + len(index)
            index += _index(channel_id, places)
        self._write(index)
        self._chunks.append(
            ChunkIndex(
                chunk_length=length,
                chunk_start_offset=begins,
                compression=COMPRESSION,
                compressed_size=len(packed),
                message_end_time=ends,
                message_index_length=len(index),
                message_index_offsets=offsets,
                message_start_time=starts,
                uncompressed_size=len(records),
            )
        )

    def _write(self, data: bytes) -> int:
        """Write what the checksum of the data counts, and return its length."""
        self._checksum = zlib.crc32(data, self._checksum)
        self._stream.write(data)
        return len(data)


class _Record(Protocol):
    def write(self, stream: RecordBuilder) -> None:
        """Write a record of the library."""


def _record(record: _Record) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()
    return data


def _index(channel_id: int, places: list[tuple[int, int]]) -> bytes:
    """Return a chunk's index of a channel: time [ns] and place of each message."""
    pairs = struct.pack(f"<{2 * len(places)}Q", *(word for pair in places for word in pair))
    head = _INDEX.pack(
        Opcode.MESSAGE_INDEX, len(pairs) + _AFTER_INDEX_LENGTH, channel_id, len(pairs)
    )
    return head + pairs
