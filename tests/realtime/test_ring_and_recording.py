import json
import struct

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.realtime import reading
from teleop_rt.realtime.mcap_index import count_messages, time_span
from teleop_rt.realtime.reading import read_messages, read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring import RingReader, RingWriter
from teleop_rt.realtime.ring_folder import Recorder, publish
from teleop_rt.realtime.ring_kernel import row_writer
from teleop_rt.signals import Signal

TABLE = (
    Signal("stamp_ns", "ns", "time"),
    Signal("force", "{f}", "force"),
    Signal("state", "count", "state"),
)
UNITS = Units(position="m", force="N")


def test_a_reader_sees_every_row_in_order_and_counts_what_was_overrun(tmp_path):
    writer = RingWriter(tmp_path / "r", 2, 16)
    reader = RingReader(tmp_path / "r")
    for number in range(10):
        writer.push(np.array([number, -number], float))
    assert reader.read()[:, 0].tolist() == list(range(10))
    assert len(reader.read()) == 0
    for number in range(10, 60):
        writer.push(np.array([number, -number], float))
    rows = reader.read()
    assert rows[:, 0].tolist() == list(range(45, 60))
    assert reader.dropped == 35


def test_a_row_that_a_kernel_writes_is_read_as_a_pushed_one(tmp_path):
    writer = RingWriter(tmp_path / "r", 3, 8)
    reader = RingReader(tmp_path / "r")
    row = np.zeros(3)
    write = row_writer(writer, row)
    for number in range(5):
        row[:] = number, -number, np.nan
        if number % 2:
            writer.push(row)
        else:
            write()
    rows = reader.read()
    assert rows[:, 0].tolist() == list(range(5))
    assert rows[:, 1].tolist() == [-number for number in range(5)]
    assert np.isnan(rows[:, 2]).all()
    assert reader.dropped == 0


def test_rows_that_are_pushed_together_are_read_as_those_pushed_one_by_one(tmp_path):
    writer = RingWriter(tmp_path / "r", 2, 8)
    reader = RingReader(tmp_path / "r")
    writer.push([0.0, 0.0])
    writer.push_rows(np.array([(number, -number) for number in range(1, 6)], float))
    writer.push_rows(np.zeros((0, 2)))
    assert reader.read().tolist() == [[number, -number] for number in range(6)]
    writer.push_rows(np.array([(number, -number) for number in range(6, 10)], float))
    writer.push([10.0, -10.0])
    numbers, rows = reader.read_numbered()
    assert rows.tolist() == [[number, -number] for number in range(6, 11)]
    assert numbers.tolist() == [7, 8, 9, 10, 11]
    assert reader.dropped == 0


def test_kernels_overrun_a_slow_reader_as_pushed_rows_do(tmp_path):
    writer = RingWriter(tmp_path / "r", 2, 16)
    reader = RingReader(tmp_path / "r")
    row = np.zeros(2)
    write = row_writer(writer, row)
    for number in range(60):
        row[:] = number, -number
        write()
    assert reader.read().tolist() == [[number, -number] for number in range(45, 60)]
    assert (reader.dropped, reader.last_read) == (45, 60)


def test_a_torn_row_is_dropped_and_counted(tmp_path):
    writer = RingWriter(tmp_path / "r", 1, 8)
    reader = RingReader(tmp_path / "r")
    for number in range(3):
        writer.push(np.array([number], float))
    with (tmp_path / "r").open("r+b") as stream:
        stream.seek(64 + 2 * 24)
        stream.write(struct.pack("d", 99))
    assert reader.read()[:, 0].tolist() == [0, 2]
    assert reader.dropped == 1


def test_a_ring_of_another_version_and_another_file_are_refused_by_name(tmp_path):
    writer = RingWriter(tmp_path / "r", 1, 8)
    for last, words in ((b"2", "a ring of another version"), (b"1", None)):
        with (tmp_path / "r").open("r+b") as stream:
            stream.write(last)
        if words is None:
            assert RingReader(tmp_path / "r").columns == 1
        else:
            with pytest.raises(ValueError, match=f"r is {words} of this program: start the daemon"):
                RingReader(tmp_path / "r")
    writer.close()
    (tmp_path / "text").write_bytes(b"x" * 100)
    with pytest.raises(ValueError, match="text is no ring of this program"):
        RingReader(tmp_path / "text")


def test_the_writer_alone_makes_and_removes_the_file_and_readers_keep_their_view(tmp_path):
    writer = RingWriter(tmp_path / "r", 1, 8)
    with pytest.raises(FileExistsError):
        RingWriter(tmp_path / "r", 1, 8)
    reader = RingReader(tmp_path / "r")
    writer.push(np.array([7.0]))
    assert not reader.closed
    writer.close()
    assert not (tmp_path / "r").exists()
    assert reader.closed
    assert reader.read().tolist() == [[7.0]]


def test_a_run_is_recorded_whole_with_null_for_an_unknown_value(tmp_path):
    ring = publish(tmp_path, "/slave", TABLE)
    recorder = Recorder(tmp_path, RecordingWriter(tmp_path / "r.mcap", UNITS))
    recorder.discover()
    ring.push(np.array([1e9, 2.5, 3]))
    recorder.drain()
    late = publish(tmp_path, "/master", TABLE)
    late.push(np.array([2e9, 0.1 + 0.2, 1]))
    ring.push(np.array([3e9, np.nan, np.nan]))
    recorder.close()
    read = read_topics(tmp_path / "r.mcap", ["/slave", "/master", "/none"])
    assert set(read) == {"/slave", "/master"}
    assert read["/slave"]["stamp_ns"].tolist() == [1e9, 3e9]
    assert read["/master"]["force"].tolist() == [0.1 + 0.2]
    assert np.isnan(read["/slave"]["force"][1])
    assert recorder.dropped == {"/slave": 0, "/master": 0}


def test_messages_are_json_without_nan_and_the_schema_contains_units(tmp_path):
    writer = RecordingWriter(tmp_path / "r.mcap", UNITS)
    writer.add_topic("/slave", TABLE)
    writer.write_rows("/slave", np.array([[5, np.inf, 2.0]]))
    writer.close()
    with (tmp_path / "r.mcap").open("rb") as stream:
        ((schema, channel, message),) = make_reader(stream).iter_messages()
    assert channel.message_encoding == "json"
    assert json.loads(message.data) == {"stamp_ns": 5, "force": None, "state": 2}
    assert message.log_time == 5
    assert "[N] force" in json.loads(schema.data)["properties"]["force"]["description"]


def test_a_recording_cut_off_is_read_up_to_its_last_flush_and_other_files_are_refused(tmp_path):
    writer = RecordingWriter(tmp_path / "r.mcap", UNITS)
    writer.add_topic("/slave", TABLE)
    for second in range(4):
        writer.write_rows("/slave", np.array([[second * 1e9, 1.0, 0]]))
        writer.flush()
    writer.write_rows("/slave", np.array([[9e9, 1.0, 0]]))
    whole = read_topics(tmp_path / "r.mcap", ["/slave"])["/slave"]
    assert whole["stamp_ns"].tolist() == [0, 1e9, 2e9, 3e9]
    cut = tmp_path / "cut.mcap"
    written = (tmp_path / "r.mcap").read_bytes()
    rows_left = []
    for length in range(len(written), len(written) // 4, -1):
        cut.write_bytes(written[:length])
        stamps = read_topics(cut, ["/slave"]).get("/slave", {"stamp_ns": np.empty(0)})["stamp_ns"]
        assert stamps.tolist() == [0, 1e9, 2e9, 3e9][: stamps.size]
        rows_left.append(stamps.size)
    assert rows_left == sorted(rows_left, reverse=True)
    assert set(rows_left) >= {4, 3, 2, 1}
    writer.close()
    other = tmp_path / "text.mcap"
    other.write_text("hello")
    with pytest.raises(RecordingError, match="not an MCAP recording"):
        read_topics(other, ["/slave"])


@pytest.mark.parametrize("indexed", [True, False])
def test_reading_from_a_stamp_on_gives_the_messages_from_there_whatever_lies_before(
    tmp_path, indexed
):
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, UNITS)
    for topic, first in (("/slave", 0), ("/estimates/late", 4_000)):  # of 6 chunks or so
        writer.add_topic(topic, TABLE)
        rows = [[n, np.sin(n), n] for n in range(first, 10_000)]
        writer.write_rows(topic, np.array(rows, dtype=float))
    writer.close()
    assert time_span(path) == (0, 9_999)
    if not indexed:
        path.write_bytes(path.read_bytes()[:-20])
        assert time_span(path) is None
    topics = ["/slave", "/estimates/"]
    whole = [(topic, json.loads(text)) for topic, text in read_messages(path, topics)]
    for from_ns in (1, 3_999, 7_000, 9_999, 20_000):
        expected = [(topic, row) for topic, row in whole if row["stamp_ns"] >= from_ns]
        found = [(topic, json.loads(text)) for topic, text in read_messages(path, topics, from_ns)]
        assert found == expected


@pytest.mark.parametrize("indexed", [True, False])
@pytest.mark.parametrize("count", [5_000, 2_049, 1_000])
def test_a_long_topic_is_thinned_evenly_and_keeps_its_ends(tmp_path, count, indexed):
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, UNITS)
    for topic in ("/slave", "/estimates/one"):
        writer.add_topic(topic, TABLE)
        writer.write_rows(topic, np.array([[n, 0.5 * n, n] for n in range(count)], dtype=float))
    writer.close()
    first, *_, last = (signal.name for signal in TABLE)
    topics = ["/slave", "/estimates/"]
    if not indexed:
        path.write_bytes(path.read_bytes()[:-20])
    counted = dict.fromkeys(("/slave", "/estimates/one"), count) if indexed else {}
    assert count_messages(path) == counted
    most = dict.fromkeys(topics, 1_000)
    read = read_topics(path, topics, {"/slave": [last, first, "no such"]}, most)
    assert list(read["/slave"]) == [first, last]
    assert list(read["/estimates/one"]) == [signal.name for signal in TABLE]
    for columns in read.values():
        rows = columns[first]
        assert 500 < rows.size <= 1_001
        assert (rows[0], rows[-1]) == (0, count - 1)
        steps = np.diff(rows[:-1])
        assert np.all(steps == steps[0])
        assert steps[0] == {5_000: 8, 2_049: 4, 1_000: 1}[count]
        assert np.array_equal(rows, columns[last])


def test_what_follows_the_last_wanted_signal_is_not_read(tmp_path):
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, UNITS)
    writer.add_topic("/slave", TABLE)
    writer.write_rows("/slave", np.array([[n, 0.5 * n, 7] for n in range(3_000)], dtype=float))
    writer.close()
    damaged = path.with_name("tail.mcap")
    with path.open("rb") as stream, damaged.open("wb") as copy:
        other = Writer(copy)
        other.start()
        schema = other.register_schema("slave", "jsonschema", b"{}")
        channel = other.register_channel("/slave", "json", schema)
        for _, _, message in make_reader(stream).iter_messages():
            first = message.log_time == 0  # which gives the names
            text = message.data if first else message.data.replace(b"7}", b"#}")
            assert first or text != message.data
            other.add_message(channel, message.log_time, text, message.log_time)
        other.finish()
    wanted = ["force", "stamp_ns"]
    found = read_topics(damaged, ["/slave"], {"/slave": wanted})["/slave"]
    assert list(found) == ["stamp_ns", "force"]
    assert np.array_equal(found["force"], 0.5 * np.arange(3_000))
    assert np.array_equal(found["stamp_ns"], np.arange(3_000))


@pytest.mark.parametrize("claimed", [0, 10, 2**62])
def test_rows_are_read_whole_however_many_were_expected(tmp_path, claimed, monkeypatch):
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, UNITS)
    writer.add_topic("/slave", TABLE)
    writer.write_rows("/slave", np.array([[n, np.nan, n] for n in range(9_000)], dtype=float))
    writer.close()
    monkeypatch.setattr(reading, "count_messages", lambda _: {"/slave": claimed})
    found = read_topics(path, ["/slave"])["/slave"]
    assert np.array_equal(found["state"], np.arange(9_000))
    assert np.isnan(found["force"]).all()


def test_a_sample_whose_position_or_force_is_no_number_is_read_as_missing(tmp_path):
    table = [Signal(name, "1", name) for name in ("stamp_ns", "position", "force", "valid")]
    rows = [[1, 0.1, 2.0, 1], [2, np.inf, 2.0, 1], [3, 0.1, np.nan, 1], [4, 0.1, 2.0, 0]]
    writer = RecordingWriter(tmp_path / "r.mcap", UNITS)
    writer.add_topic("/slave", table)
    writer.write_rows("/slave", np.array(rows, float))
    writer.close()
    assert read_topics(tmp_path / "r.mcap", ["/slave"])["/slave"]["valid"].tolist() == [1, 0, 0, 0]
