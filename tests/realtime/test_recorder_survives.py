"""Recordings after a crash, and the recorder on a disk that refuses to write."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.realtime import ring_folder as ring_folder_module
from teleop_rt.realtime.export import recover
from teleop_rt.realtime.reading import read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring import RingReader
from teleop_rt.realtime.ring_folder import RECORDER_STATE, Recorder, publish
from teleop_rt.signals import Signal
from teleop_rt.trial.folder import write_json

TABLE = (Signal("stamp_ns", "ns", "time"), Signal("force", "{f}", "force"))
UNITS = Units(position="m", force="N")


class SmallDisk:
    """Takes so many bytes and then has no room, as write(2) reports it."""

    def __init__(self, room: int) -> None:
        self.room = room
        self._write = os.write

    def write(self, descriptor: int, data: bytes) -> int:
        if self.room == 0:
            raise OSError(28, "No space left on device")
        taken = self._write(descriptor, data[: self.room])
        self.room -= taken
        return taken


@pytest.fixture
def disk(monkeypatch):
    small = SmallDisk(10**9)
    monkeypatch.setattr("teleop_rt.realtime.output.os.write", small.write)
    return small


def rows(start: int, count: int) -> np.ndarray:
    numbers = np.arange(start, start + count, dtype=float)
    return np.column_stack([numbers * 1e6, np.sin(numbers)])


def recorder_of(folder: Path):
    ring = publish(folder, "/slave", TABLE)
    recorder = Recorder(folder, RecordingWriter(folder / "r.mcap", UNITS))
    recorder.discover()
    return ring, recorder


def stamps(path: Path) -> list[float]:
    return (read_topics(path, ["/slave"])["/slave"]["stamp_ns"] * 1e-6).tolist()


def recovered(cut: Path, whole: Path) -> int:
    """Return the number of messages saved: 0 where nothing could be, and nothing was written."""
    try:
        return recover(cut, whole)
    except RecordingError as error:
        assert "nothing can be recovered" in str(error)
        assert not whole.exists()
        return 0


def test_a_recording_cut_at_any_byte_is_recovered_up_to_its_last_whole_chunk(tmp_path):
    writer = RecordingWriter(tmp_path / "r.mcap", UNITS)
    writer.add_topic("/slave", TABLE)
    for start in range(0, 6, 2):
        writer.write_rows("/slave", rows(start, 2))
        writer.flush()
    writer.close()
    data = (tmp_path / "r.mcap").read_bytes()
    cut, whole = tmp_path / "cut.mcap", tmp_path / "whole.mcap"
    saved = []
    for length in range(len(data) + 1):
        for path in (cut, whole):
            path.unlink(missing_ok=True)  # to write over a file waits for the disk
        cut.write_bytes(data[:length])
        saved.append(recovered(cut, whole))
        assert saved[-1] == 0 or stamps(whole) == list(range(saved[-1]))
    assert saved == sorted(saved)
    assert set(saved) == {0, 2, 4, 6}
    (tmp_path / "text").write_text("hello")
    with pytest.raises(RecordingError, match="not an MCAP"):
        recover(tmp_path / "text", tmp_path / "w.mcap")


def test_a_full_disk_raises_an_alarm_and_nothing_is_lost_once_there_is_room(tmp_path, disk):
    ring, recorder = recorder_of(tmp_path)
    disk.room = 700
    for start in range(0, 3000, 50):
        for row in rows(start, 50):
            ring.push(row)
        assert recorder.drain() == 50
        recorder.flush()
    assert "No space left on device" in recorder.alarm
    assert "make room" in recorder.alarm
    recorder.publish_state()
    assert json.loads((tmp_path / RECORDER_STATE).read_text())["alarm"] == recorder.alarm
    on_disk = (tmp_path / "r.mcap").stat().st_size
    assert on_disk == 700
    disk.room = 10**9
    recorder.flush()
    assert recorder.alarm == ""
    recorder.close()
    assert stamps(tmp_path / "r.mcap") == list(range(3000))
    assert recorder.dropped == {"/slave": 0}


def test_a_recorder_that_ends_while_the_disk_refuses_is_followed_from_where_that_had_come_to(
    tmp_path, disk
):
    ring, recorder = recorder_of(tmp_path)
    for room, start, end in ((10**9, 0, 20), (0, 20, 50)):
        disk.room = room
        for row in rows(start, end - start):
            ring.push(row)
        recorder.drain()
        recorder.flush()
        recorder.publish_state()
    disk.room = 10**9
    following = Recorder(tmp_path, RecordingWriter(tmp_path / "next.mcap", UNITS))
    following.close()
    assert recover(tmp_path / "r.mcap", tmp_path / "whole.mcap") == 20
    assert stamps(tmp_path / "next.mcap") == list(range(20, 50))


def test_a_disk_that_stays_full_costs_bounded_memory_and_counted_rows(tmp_path, disk, monkeypatch):
    monkeypatch.setattr(ring_folder_module, "MOST_WAITING_BYTES", 20_000)
    ring = publish(tmp_path, "/slave", TABLE)
    writer = RecordingWriter(tmp_path / "r.mcap", UNITS)
    recorder = Recorder(tmp_path, writer)
    recorder.discover()
    disk.room = 5000
    written = 0
    for start in range(0, 20_000, 100):
        for row in rows(start, 100):
            ring.push(row)
        written += recorder.drain()
        recorder.flush()
    assert 0 < written < 20_000
    assert recorder.dropped == {"/slave": 20_000 - written}
    assert writer.waiting_bytes < 30_000
    recorder.close()
    assert "No space" in recorder.alarm
    left = stamps(tmp_path / "r.mcap")
    assert left == list(range(len(left)))
    assert len(left) >= 100


@pytest.mark.skipif(os.geteuid() != 0, reason="mounting takes root")
def test_a_tmpfs_that_fills_up_holds_the_loop_up_by_nothing(tmp_path):
    small = tmp_path / "small"
    small.mkdir()
    mounted = subprocess.run(
        ["/bin/mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", small], check=False
    )
    if mounted.returncode:
        pytest.skip("this machine does not let a test mount a tmpfs")
    try:
        ring = publish(tmp_path, "/slave", TABLE)
        recorder = Recorder(tmp_path, RecordingWriter(small / "r.mcap", UNITS))
        recorder.discover()
        for start in range(0, 20_000, 100):
            for row in rows(start, 100):
                ring.push(row)
            recorder.drain()
            recorder.flush()
        assert "No space left on device" in recorder.alarm
        reader = RingReader(ring.path)
        reader.read()
        assert reader.dropped == 20_000 - 8191
        recorder.close()
        left = stamps(small / "r.mcap")
        assert left == list(range(len(left)))
    finally:
        subprocess.run(["/bin/umount", small], check=True)


def test_a_file_that_cannot_be_made_is_reported_with_its_path_and_the_cause(tmp_path):
    with pytest.raises(RecordingError, match=r"r\.mcap: cannot be written: No such file"):
        RecordingWriter(tmp_path / "missing" / "r.mcap", UNITS)


RECORDING = """
import sys, time
from pathlib import Path
from teleop_rt.config.section import Units
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring_folder import Recorder
ring_folder = Path(sys.argv[1])
writer = RecordingWriter(ring_folder / "r.mcap", Units(position="m", force="N"))
recorder = Recorder(ring_folder, writer)
recorder.discover()
print("ready", flush=True)
flushed = 0
while True:
    flushed += recorder.drain()
    recorder.flush()
    print(flushed, flush=True)
    time.sleep(0.02)
"""


@pytest.mark.realtime
@pytest.mark.parametrize("kills", range(3))
def test_a_killed_recorder_leaves_all_but_the_last_rows_readable(tmp_path, kills):
    """The bound in time is the campaign's; here every row that was flushed must be there."""
    ring = publish(tmp_path, "/slave", TABLE)
    process = subprocess.Popen(
        [sys.executable, "-c", RECORDING, tmp_path], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    for row in rows(0, 2000):
        ring.push(row)
    while int(process.stdout.readline()) < 2000:
        pass
    for row in rows(2000, 500):
        ring.push(row)
    process.send_signal(signal.SIGKILL)
    process.wait()
    process.stdout.close()
    recording = tmp_path / "r.mcap"
    left = stamps(recording)
    assert left == list(range(len(left)))
    assert len(left) >= 2000
    assert recover(recording, tmp_path / "whole.mcap") == len(left)


def test_a_file_of_json_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    def full(path, text, **_):
        path.touch()
        raise OSError(28, "No space left on device")

    write_json(tmp_path / "a.json", {"a": float("nan")})
    assert json.loads((tmp_path / "a.json").read_text()) == {"a": None}
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OSError, match="No space"):
        write_json(tmp_path / "b.json", {})
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
