"""Recordings that somebody damaged are refused, or read as far as they go with a word."""

from __future__ import annotations

import json
import signal
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC, Writer
from mcap_bytes import contents_of

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.interrupts import StopRequest
from teleop_rt.realtime import mcap_records
from teleop_rt.realtime.export import recover
from teleop_rt.realtime.mcap_chunk import Unreadable
from teleop_rt.realtime.reading import read_messages, read_metadata, read_records, read_topics
from teleop_rt.realtime.recording import ONLINE, RecordingWriter
from teleop_rt.recordings.layout import layout_of
from teleop_rt.recordings.recording import load
from teleop_rt.signals import SLAVE, SLAVE_TOPIC

TOPICS = ("/a", "/b")


def recorded(path: Path) -> bytes:
    writer = RecordingWriter(path, Units(position="m", force="N"))
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    rows = np.random.default_rng(1).normal(size=(6000, len(SLAVE)))
    rows[:, [signal.name for signal in SLAVE].index("stamp_ns")] = np.arange(6000)
    writer.write_rows(SLAVE_TOPIC, rows)
    writer.close()
    return path.read_bytes()


def test_a_recording_damaged_in_the_middle_says_so(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    data = bytearray(recorded(path))
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)
    found = read_topics(path, [SLAVE_TOPIC])
    assert 0 < found[SLAVE_TOPIC]["tick"].size < 6000
    assert "damaged" in capsys.readouterr().err


@pytest.mark.parametrize("which", [0, 3, -1])
def test_a_damaged_chunk_costs_its_own_rows_only_and_is_counted(tmp_path, capsys, which):
    path = tmp_path / "run.mcap"
    data = bytearray(recorded(path))
    whole = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["stamp_ns"]
    begin, end = contents_of(data, Opcode.CHUNK)[which]
    middle = (begin + end) // 2
    data[middle : middle + 2000] = bytes(2000)
    path.write_bytes(data)
    (lost,) = [one for one in read_records(path) if isinstance(one, Unreadable)]
    kept = (whole < lost.first_ns) | (whole > lost.last_ns)
    assert lost.messages == np.count_nonzero(~kept) > 100
    found = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["stamp_ns"]
    np.testing.assert_array_equal(found, whole[kept])
    said = capsys.readouterr().err
    assert said.count("cannot be read") == 1
    assert f"1 part of the file with {lost.messages} messages" in said
    left: list[Unreadable] = []
    assert recover(path, tmp_path / "w.mcap", left) == found.size
    assert left == [lost]
    again = read_topics(tmp_path / "w.mcap", [SLAVE_TOPIC])[SLAVE_TOPIC]["stamp_ns"]
    np.testing.assert_array_equal(again, found)


def damaged_framing(data: bytearray, which: int, how: str) -> None:
    """Damage the frame of a chunk: its length, its head, or its end with the head behind it."""
    begin, end = contents_of(data, Opcode.CHUNK)[which]
    if how == "longer":
        data[begin - 6] += 4  # by 256 kB: it ends beyond the next chunk
    elif how == "too long":
        data[begin - 3] ^= 0xFF
    elif how == "shorter":
        data[begin - 6] = 0
    elif how == "no opcode":
        data[begin - 9] = 0x55
    elif how == "no head":
        data[begin - 9 : begin + 40] = bytes(range(100, 149))
    elif how == "zeros":
        data[begin - 9 : begin + 40] = bytes(49)
    else:
        data[(begin + end) // 2 : end + 9] = bytes(end + 9 - (begin + end) // 2)


@pytest.mark.parametrize("which", [0, 3])
@pytest.mark.parametrize(
    "how", ["longer", "too long", "shorter", "no opcode", "no head", "zeros", "no end"]
)
def test_a_damaged_frame_costs_its_own_chunk_only_and_is_counted(tmp_path, capsys, how, which):
    path = tmp_path / "run.mcap"
    data = bytearray(recorded(path))
    whole = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["stamp_ns"]
    begin, _ = contents_of(data, Opcode.CHUNK)[which]
    first, last = (int.from_bytes(data[at : at + 8], "little") for at in (begin, begin + 8))
    damaged_framing(data, which, how)
    path.write_bytes(data)
    found = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["stamp_ns"]
    said = capsys.readouterr().err
    if how == "longer":  # its content is whole, and so it ends where that does
        np.testing.assert_array_equal(found, whole)
        assert said == ""
        return
    kept = (whole < first) | (whole > last)
    np.testing.assert_array_equal(found, whole[kept])
    count = np.count_nonzero(~kept)
    lost = "an unknown number of" if how == "no end" else f"{count}"
    assert f"1 part of the file with {lost} messages" in said
    assert count > 100
    assert recover(path, tmp_path / "w.mcap") == found.size


def test_a_damaged_frame_costs_no_later_chunk_of_a_file_without_an_end(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    data = bytearray(recorded(path))
    chunks = contents_of(data, Opcode.CHUNK)
    damaged_framing(data, 3, "no head")
    path.write_bytes(data[: chunks[-1][1] - 1000])
    found = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["stamp_ns"]
    lost = np.flatnonzero(np.diff(found) > 1.0)
    assert lost.size == 1
    assert found[-1] > 4000
    gap = int(found[lost[0] + 1] - found[lost[0]]) - 1
    assert f"1 part of the file with {gap} messages" in capsys.readouterr().err


def test_chunks_of_before_are_left_out_of_a_file_with_a_damaged_frame_too(tmp_path):
    path = tmp_path / "run.mcap"
    data = bytearray(recorded(path))
    damaged_framing(data, 3, "no head")
    path.write_bytes(data)
    found = [json.loads(text)["stamp_ns"] for _, text in read_messages(path, [SLAVE_TOPIC], 3000)]
    assert found[0] == 3000
    assert len(found) == 3000


def test_a_flipped_bit_is_never_read_as_if_it_were_right(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, Units(position="m", force="N"), {ONLINE: {"settings": "1.25"}})
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    writer.write_rows(SLAVE_TOPIC, np.arange(20.0 * len(SLAVE)).reshape(20, len(SLAVE)))
    writer.close()
    data = path.read_bytes()

    def read():
        return read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC], read_metadata(path, ONLINE)

    rows, metadata = read()
    silent = []
    for at in range(len(MCAP0_MAGIC), len(data), 7):
        path = tmp_path / f"{at}.mcap"
        path.write_bytes(data[:at] + bytes([data[at] ^ 1 << at % 8]) + data[at + 1 :])
        try:
            found, result = read()
            same = result == metadata and all(
                np.array_equal(found.get(name), rows[name], equal_nan=True) for name in rows
            )
        except (RecordingError, KeyError):
            same = False
        if not same and "damaged" not in capsys.readouterr().err:
            silent.append(at)
    assert silent == []


def unchecked(path: Path) -> tuple[bytes, list[tuple[int, int]]]:
    """Write two topics in many chunks without a checksum of the file; return bytes and indices."""
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=4096, enable_data_crcs=False)
        writer.start()
        schema = writer.register_schema("s", "jsonschema", b"{}")
        channels = [writer.register_channel(topic, "json", schema) for topic in ("/a", "/b")]
        for number in range(1, 2001):
            text = b'{"number":%d}' % number
            writer.add_message(channels[number % 3 == 0], number, text, number, number)
        writer.finish()
    data = path.read_bytes()
    indices = [(begin, end - begin) for begin, end in contents_of(data, Opcode.MESSAGE_INDEX)]
    return data, indices


def numbers(path: Path) -> dict[str, list[float]]:
    return {topic: rows["number"].tolist() for topic, rows in read_topics(path, TOPICS).items()}


def test_a_message_index_that_lies_changes_no_row(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    data, indices = unchecked(path)
    truth = numbers(path)
    assert list(truth) == ["/a", "/b"]
    assert truth["/b"] == list(range(3, 2001, 3))
    assert len(indices) > 20
    at, _ = indices[10]
    pairs = at + 6
    swapped = data[pairs + 16 : pairs + 32] + data[pairs : pairs + 16]
    lies = {
        "elsewhere": (pairs + 8, b"\x07"),
        "far away": (pairs + 8, b"\xff" * 8),
        "out of order": (pairs, swapped),
        "the same twice": (pairs + 16, data[pairs : pairs + 16]),
        "another channel": (at, b"\x09\0"),
        "shorter": (at + 2, (16).to_bytes(4, "little")),
        "odd": (at + 2, (17).to_bytes(4, "little")),
    }
    for name, (place, lie) in lies.items():
        path.write_bytes(data[:place] + lie + data[place + len(lie) :])
        assert numbers(path) == truth, name
    assert capsys.readouterr().err == ""


def test_rows_are_the_same_with_and_without_an_index(tmp_path, monkeypatch):
    path = tmp_path / "run.mcap"
    recorded(path)
    by_index = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]
    walked = []

    def walk(data, indices):
        walked.append(len(indices))

    monkeypatch.setattr(mcap_records, "indexed", walk)
    one_by_one = read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]
    assert len(walked) > 3
    assert all(walked)
    for name, values in by_index.items():
        np.testing.assert_array_equal(values, one_by_one[name])


def test_a_recording_that_a_crash_cut_off_is_read_without_a_word(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    data = recorded(path)
    path.write_bytes(data[: len(data) // 2])
    assert 0 < read_topics(path, [SLAVE_TOPIC])[SLAVE_TOPIC]["tick"].size < 6000
    assert capsys.readouterr().err == ""


def test_a_jump_in_time_is_refused_before_memory_is_taken(tmp_path):
    time_s = np.arange(1000) * 1e-3
    time_s[500:] += 1e9
    path = tmp_path / "jump.npz"
    np.savez(path, t_s=time_s, x_m=np.sin(9 * time_s), f_N=np.cos(9 * time_s))
    with pytest.raises(RecordingError, match="jumps by 1e"):
        load(path)


def test_an_array_that_claims_more_than_memory_is_refused(tmp_path):
    path = tmp_path / "claim.npz"
    header = "{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999,), }"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("t_s.npy", b"\x93NUMPY\x01\x00v\x00" + header.ljust(117).encode() + b"\n")
    with pytest.raises(RecordingError, match="its columns take 762939 MB"):
        load(path)


@pytest.mark.parametrize("short", ["t_s", "x_m", "f_N", "reference"])
def test_columns_of_different_length_are_refused(tmp_path, short):
    now = np.arange(3000) * 1e-3
    columns = dict.fromkeys(("t_s", "x_m", "f_N", "reference"), now) | {short: now[:10]}
    np.savez(tmp_path / "run.npz", **columns)
    layout = layout_of(tmp_path / "run.npz", {"reference": "reference"}, {"reference": "m"})
    with pytest.raises(RecordingError, match=rf"of different length.*{'|'.join(('10', short))}"):
        load(tmp_path / "run.npz", layout)


def test_a_hang_up_asks_for_an_orderly_stop():
    numbers = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    before = [signal.getsignal(number) for number in numbers]
    try:
        stop = StopRequest()
        signal.raise_signal(signal.SIGHUP)
        assert stop()
    finally:
        for number, handler in zip(numbers, before, strict=True):
            signal.signal(number, handler)
