"""A kernel finds the messages of a chunk where a walk in Python does, and leaves all else to it."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.realtime import mcap_records
from teleop_rt.realtime.chunk_kernel import MessageFinder
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import SLAVE, SLAVE_TOPIC

CHANNELS = (7, 1, 300, 65_535)


def message(rng: np.random.Generator, text_bytes: int) -> bytes:
    fields = struct.pack("<HIQQ", rng.choice(CHANNELS), rng.integers(1 << 32), 1, 2)
    content = fields + rng.bytes(text_bytes)
    return struct.pack("<BQ", 5, len(content)) + content


def chunk(seed: int) -> bytes:
    rng = np.random.default_rng(seed)
    return b"".join(message(rng, rng.choice((0, 1, 3, 500))) for _ in range(rng.integers(1, 60)))


@pytest.mark.parametrize("seed", range(20))
def test_messages_lie_where_a_walk_finds_them_and_channels_come_in_the_same_order(seed):
    data = chunk(seed)
    found = MessageFinder().places(data)
    (walked,) = mcap_records._walk(data)
    assert list(found) == list(walked.places)
    for channel, places in walked.places.items():
        np.testing.assert_array_equal(found[channel], places)


def test_a_smaller_chunk_after_a_larger_one_has_only_its_own_messages():
    finder, small = MessageFinder(), message(np.random.default_rng(1), 5)
    finder.places(chunk(3))
    (places,) = finder.places(small).values()
    assert places[:, :2].tolist() == [[31, 36]]


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:-1],
        lambda data: data + b"\5",
        lambda data: data + struct.pack("<BQ", 5, 1 << 63) + bytes(40),
        lambda data: data + struct.pack("<BQ", 5, (1 << 63) - 1) + bytes(40),
        lambda data: data + struct.pack("<BQ", 5, 21) + bytes(21),
        lambda data: data + struct.pack("<BQ", 12, 22) + bytes(22),
    ],
)
def test_a_chunk_with_anything_but_whole_messages_is_left_to_the_walk(damage):
    assert MessageFinder().places(chunk(1)) is not None
    assert MessageFinder().places(damage(chunk(1))) is None


def test_a_chunk_of_too_many_channels_is_left_to_the_walk():
    records = [struct.pack("<BQHIQQ", 5, 22, channel, 0, 0, 0) for channel in range(1025)]
    assert MessageFinder().places(b"".join(records)) is None
    assert len(MessageFinder().places(b"".join(records[:1024]))) == 1024


def test_a_large_file_is_read_as_a_small_one_also_where_it_was_cut_off(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, Units(position="m", force="N"))
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    rows = np.random.default_rng(1).normal(size=(3000, len(SLAVE)))
    rows[:, [signal.name for signal in SLAVE].index("stamp_ns")] = np.arange(3000)
    writer.write_rows(SLAVE_TOPIC, rows)
    writer.close()
    whole = path.read_bytes()
    for size in (len(whole), len(whole) // 2):
        path.write_bytes(whole[:size])
        plain = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]
        with monkeypatch.context() as patch:
            patch.setattr(mcap_records, "_BYTES_FOR_KERNEL", 0)
            patch.setattr(mcap_records, "indexed", None)  # not called: the kernel is in its place
            found = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]
        assert {name: values.tobytes() for name, values in found.items()} == {
            name: values.tobytes() for name, values in plain.items()
        }
