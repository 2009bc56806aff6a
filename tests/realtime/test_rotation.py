"""A recording in parts: rotated, pruned, cut, taken up by the next recorder, and read as one."""

import numpy as np
import pytest

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.offline.load import load_online
from teleop_rt.realtime.export import export, recover
from teleop_rt.realtime.parts import part, parts
from teleop_rt.realtime.reading import read_metadata, read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.realtime.ring_folder import Recorder, publish
from teleop_rt.realtime.rotation import RotatingWriter, Sizes
from teleop_rt.signals import Signal

TABLE = (Signal("stamp_ns", "ns", "time"), Signal("force", "{f}", "force"))
UNITS = Units(position="m", force="N")
MADE_BY = {"made-by": {"rig": "bench"}}
MANY = Sizes(part_bytes=4000, part_s=1e9, kept_bytes=10**9)


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class RecordedRun:
    """Rings that a loop pushes into, and one recorder after the other beside it."""

    def __init__(self, folder, sizes=MANY):
        self.folder, self.sizes, self.clock = folder, sizes, Clock()
        self.recording = folder / "r.mcap"
        self.ring = publish(folder, "/slave", TABLE)
        self.pushed = 0
        self.recorder = self.new_recorder()

    def new_recorder(self):
        writer = RotatingWriter(self.recording, UNITS, MADE_BY, self.sizes, self.clock)
        recorder = Recorder(self.folder, writer)
        recorder.discover()
        return recorder

    def push(self, count):
        for number in range(self.pushed, self.pushed + count):
            self.ring.push(np.array([number * 1e6, float(number)]))
        self.pushed += count

    def record(self, count):
        for _ in range(count // 50):
            self.push(50)
            self.turn()

    def turn(self):
        """One cycle of the recorder's process."""
        self.recorder.drain()
        self.recorder.flush()
        self.recorder.publish_state()

    def forces(self):
        return read_topics(self.recording, ["/slave"])["/slave"]["force"].tolist()


def test_a_part_that_is_large_or_old_is_followed_by_the_next_and_all_are_read_as_one(tmp_path):
    run = RecordedRun(tmp_path)
    run.record(1000)
    by_size = len(parts(run.recording))
    assert by_size >= 4
    for path in parts(run.recording)[:-1]:
        assert 4000 <= path.stat().st_size < 8000
        assert read_metadata(path, "made-by") == {"rig": "bench"}
    run.sizes = run.recorder.writer.sizes = Sizes(10**9, 60.0, 10**9)
    run.turn()
    assert len(parts(run.recording)) == by_size
    run.clock.now += 60
    run.record(100)
    assert len(parts(run.recording)) == by_size + 1
    run.recorder.close()
    assert run.forces() == list(range(1100))
    (alone,) = parts(parts(run.recording)[1])
    assert 0 < read_topics(alone, ["/slave"])["/slave"]["force"].size < 1100


def test_parts_are_exported_and_recovered_as_one_file(tmp_path):
    run = RecordedRun(tmp_path)
    run.record(1000)
    (tmp_path / "r.part12.mcap").write_text("no part: too few digits")
    (tmp_path / "rr.part0002.mcap").write_text("another recording's")
    assert export(run.recording, tmp_path / "t.npz", "/slave") == run.pushed
    assert recover(run.recording, tmp_path / "whole.mcap") == run.pushed
    whole = read_topics(tmp_path / "whole.mcap", ["/slave"])["/slave"]["force"]
    assert whole.tolist() == list(range(1000))
    assert read_metadata(tmp_path / "whole.mcap", "made-by") == {"rig": "bench"}


def test_the_oldest_parts_make_room_but_never_the_last_two(tmp_path):
    run = RecordedRun(tmp_path, Sizes(part_bytes=4000, part_s=1e9, kept_bytes=14_000))
    run.record(3000)
    left = parts(run.recording)
    assert 2 <= len(left) <= 4
    assert sum(path.stat().st_size for path in left[:-1]) <= 14_000
    assert not run.recording.exists()
    forces = run.forces()
    assert forces == list(range(3000 - len(forces), 3000))
    run.recorder.writer.sizes = Sizes(4000, 1e9, 1, kept_parts=2)
    before = run.pushed
    run.record(1000)
    assert len(parts(run.recording)) == 2
    assert run.forces()[-1] == before + 999
    run.recorder.writer.sizes = Sizes(4000, 1e9, 10**9, kept_parts=3)
    run.record(1000)
    assert len(parts(run.recording)) == 3


def test_the_last_second_before_a_fault_is_there_whatever_is_rotated_meanwhile(tmp_path):
    """No part that the config allows is shorter than a second, which is 1000 rows here."""
    run = RecordedRun(tmp_path, Sizes(part_bytes=10**9, part_s=1.0, kept_bytes=1))
    for tenth in range(1, 36):
        run.clock.now += 0.1
        run.record(100)
        if tenth in {10, 11, 19, 20, 21, 30, 31, 35}:
            forces = run.forces()
            assert forces == list(range(int(forces[0]), run.pushed))
            assert len(forces) >= 1000
    assert len(parts(run.recording)) == 2
    assert not run.recording.exists()


@pytest.mark.parametrize("rows_since_the_last_flush", [0, 70])
def test_a_recorder_that_crashed_is_followed_by_one_that_loses_nothing(
    tmp_path, rows_since_the_last_flush
):
    run = RecordedRun(tmp_path)
    run.record(200)
    run.push(rows_since_the_last_flush)
    run.recorder.drain()  # and then it is killed: nothing is finished, nothing handed over
    run.push(300)
    run.recorder = run.new_recorder()
    run.record(100)
    run.recorder.close()
    assert run.forces() == list(range(run.pushed))
    assert run.recorder.dropped == {"/slave": 0}


def test_rows_that_were_written_but_not_confirmed_are_read_once(tmp_path):
    run = RecordedRun(tmp_path, Sizes(10**9, 1e9, 10**9))
    run.record(200)
    run.push(100)
    run.recorder.drain()
    run.recorder.flush()  # and killed before it could say so
    run.recorder = run.new_recorder()
    run.record(50)
    run.recorder.close()
    first = rows_of_the_first_part(run.recording)
    second = read_topics(part(run.recording, 2), ["/slave"])["/slave"]["force"]
    assert first == 300
    assert second[0] == 200
    assert run.forces() == list(range(350))


def rows_of_the_first_part(path) -> int:
    """Return the rows of the first part alone."""
    alone = path.with_name("alone.mcap")
    alone.write_bytes(path.read_bytes())
    return read_topics(alone, ["/slave"])["/slave"]["force"].size


def test_what_was_overrun_while_no_recorder_ran_is_counted_on(tmp_path):
    run = RecordedRun(tmp_path)
    run.record(100)
    run.recorder.dropped_before = {"/slave": 7, "/gone": 1}
    run.turn()
    run.push(10_000)
    run.recorder = run.new_recorder()
    run.turn()
    lost = 10_000 - 8191
    assert run.recorder.dropped == {"/slave": lost + 7, "/gone": 1}
    forces = run.forces()
    assert len(forces) == 100 + 8191
    assert forces[100] == 100 + lost


def test_numbers_beyond_32_bits_are_distinguished(tmp_path):
    path = tmp_path / "r.mcap"
    start = 2**32 - 3
    for number, rows in ((1, range(5)), (2, range(3, 9))):
        writer = RecordingWriter(part(path, number), UNITS)
        writer.add_topic("/slave", TABLE)
        table = np.array([[row * 1e6, row] for row in rows])
        writer.write_rows("/slave", table, [start + row for row in rows])
        writer.close()
    assert read_topics(path, ["/slave"])["/slave"]["force"].tolist() == list(range(9))


def test_parts_whose_topics_came_in_another_order_are_not_mixed_up(tmp_path):
    path = tmp_path / "r.mcap"
    for number, topics in ((1, ("/slave", "/other")), (2, ("/other", "/slave"))):
        writer = RecordingWriter(part(path, number), UNITS)
        for value, topic in enumerate(topics):
            writer.add_topic(topic, TABLE)
            writer.write_rows(topic, np.array([[number * 1e6, topic == "/slave"]]), [number])
            assert value < 2
        writer.close()
    assert read_topics(path, ["/slave"])["/slave"]["force"].tolist() == [1, 1]
    assert recover(path, tmp_path / "w.mcap") == 4
    assert read_topics(tmp_path / "w.mcap", ["/other"])["/other"]["force"].tolist() == [0, 0]


def test_a_disk_that_refuses_the_next_part_keeps_the_last_one_going(tmp_path, monkeypatch):
    run = RecordedRun(tmp_path)

    def refused(*_):
        raise RecordingError("r.part0002.mcap: cannot be written: Read-only file system")

    with monkeypatch.context() as read_only:
        read_only.setattr("teleop_rt.realtime.rotation.RecordingWriter", refused)
        run.record(1000)
        assert "Read-only file system" in run.recorder.alarm
    assert parts(run.recording) == [run.recording]
    run.record(50)
    assert run.recorder.alarm == ""
    assert len(parts(run.recording)) == 2
    assert run.forces() == list(range(1050))


def test_a_recording_that_is_not_there_is_reported_by_its_own_name(tmp_path):
    with pytest.raises(RecordingError, match=r"r\.mcap: cannot be read"):
        load_online(tmp_path / "r.mcap")
