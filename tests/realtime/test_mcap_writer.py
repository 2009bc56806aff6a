"""The writer of many messages against the library's own: the same bytes."""

from __future__ import annotations

from io import BytesIO

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from teleop_rt.realtime.mcap_writer import ChunkedWriter

CHUNK = 4096


class Library:
    """The library's writer, with the interface of ours."""

    def __init__(self, stream: BytesIO) -> None:
        zstd = CompressionType.ZSTD
        self._writer = Writer(stream, CHUNK, compression=zstd, enable_data_crcs=True)
        self._writer.start(library="teleop-rt")
        self.add_metadata = self._writer.add_metadata
        self.register_schema = self._writer.register_schema
        self.register_channel = self._writer.register_channel
        self.flush, self.finish = self._writer.flush, self._writer.finish

    def add_messages(self, channel_id, messages) -> None:
        for stamp_ns, text, number in messages:
            self._writer.add_message(channel_id, stamp_ns, text, stamp_ns, number)


def written(writer, stream: BytesIO, blocks: int, *, flushed: bool = False) -> bytes:
    """Return a file of three topics; their stamps run to and fro, some blocks are empty."""
    rng = np.random.default_rng(blocks)
    writer.add_metadata("run", {"trial": "silicone", "unit": "°"})
    channels = []
    for name in ("slave", "master", "never"):
        schema_id = writer.register_schema(name, "jsonschema", b'{"type":"object"}')
        channels.append(writer.register_channel(f"/{name}", "json", schema_id))
    writer.add_metadata("online-estimation", {})
    for number in range(blocks):
        size = rng.choice([0, 1, 40])
        stamps, sizes = rng.integers(2**63, size=size), rng.integers(300, size=size)
        some = [(int(t), bytes(n), i) for i, (t, n) in enumerate(zip(stamps, sizes, strict=True))]
        writer.add_messages(channels[number % 2], some)
        if flushed and number % 7 == 0:
            writer.flush()
    writer.finish()
    return stream.getvalue()


@pytest.mark.parametrize("flushed", [False, True])
@pytest.mark.parametrize("blocks", [0, 1, 2, 50])
def test_the_bytes_are_those_of_the_library(blocks: int, flushed: bool) -> None:
    ours, theirs = BytesIO(), BytesIO()
    found = written(ChunkedWriter(ours, CHUNK, "teleop-rt"), ours, blocks, flushed=flushed)
    assert found == written(Library(theirs), theirs, blocks, flushed=flushed)


def test_the_library_reads_what_was_written() -> None:
    stream = BytesIO()
    writer = ChunkedWriter(stream, CHUNK, "teleop-rt")
    channel = writer.register_channel("/slave", "json", writer.register_schema("a", "b", b"c"))
    rows = [(7 + number, b"x" * number, number) for number in range(200)]
    writer.add_messages(channel, rows)
    writer.finish()
    read = make_reader(BytesIO(stream.getvalue()), validate_crcs=True).iter_messages()
    assert [(m.log_time, m.data, m.sequence) for _, _, m in read] == rows
    summary = make_reader(BytesIO(stream.getvalue())).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    assert summary.statistics.message_count == len(rows)
    assert len(summary.chunk_indexes) > 3
