"""Recordings that somebody damaged are refused, or read as far as they go with a word."""

from __future__ import annotations

import signal
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import MCAP0_MAGIC

from teleop_rt.diagnosis.recordings import table_files
from teleop_rt.diagnosis.recordings.recording import load
from teleop_rt.errors import RecordingError
from teleop_rt.realtime.loop import StopRequest
from teleop_rt.realtime.recording import ONLINE, RecordingWriter, read_metadata, read_topics
from teleop_rt.section import Units
from teleop_rt.signals import SLAVE, SLAVE_TOPIC


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


def test_a_flipped_bit_is_never_read_as_if_it_were_right(tmp_path, capsys):
    path = tmp_path / "run.mcap"
    writer = RecordingWriter(path, Units(position="m", force="N"), {ONLINE: {"settings": "1.25"}})
    writer.add_topic(SLAVE_TOPIC, SLAVE)
    writer.write_rows(SLAVE_TOPIC, np.arange(50.0 * len(SLAVE)).reshape(50, len(SLAVE)))
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


def test_an_archive_that_unpacks_to_more_than_memory_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(table_files, "_MOST_BYTES", 10_000)
    path = tmp_path / "huge.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x_m.npy", bytes(1_000_000))
    with pytest.raises(RecordingError, match="unpacks to"):
        load(path)


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
