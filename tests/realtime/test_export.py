import csv

import numpy as np
import pytest
from scipy.io import loadmat

from teleop_rt.errors import RecordingError
from teleop_rt.realtime.export import export, recover
from teleop_rt.realtime.recording import RecordingWriter, read_metadata, read_topics
from teleop_rt.section import Units
from teleop_rt.signals import Signal

TABLE = (Signal("stamp_ns", "ns", "time"), Signal("force", "{f}", "force"))
ROWS = np.array([[1e9, 1.5], [2e9, np.nan], [3e9, -0.1]])


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "r.mcap"
    units = Units(position="m", force="N")
    writer = RecordingWriter(path, units, {"made-by": {"rig": "bench"}})
    writer.add_topic("/slave", TABLE)
    for row in ROWS:
        writer.write_rows("/slave", row[None])
        writer.flush()
    writer.close()
    return path


def test_a_cut_recording_is_made_whole_with_all_that_was_readable(recording, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(recording.read_bytes()[:700])
    readable = read_topics(cut, ["/slave"])["/slave"]["stamp_ns"].tolist()
    assert 0 < len(readable) <= 3
    assert recover(cut, tmp_path / "whole.mcap") == len(readable)
    assert (
        read_topics(tmp_path / "whole.mcap", ["/slave"])["/slave"]["stamp_ns"].tolist() == readable
    )
    assert read_metadata(tmp_path / "whole.mcap", "made-by") == {"rig": "bench"}
    with pytest.raises(RecordingError, match="exists already"):
        recover(cut, tmp_path / "whole.mcap")


def test_a_topic_is_exported_as_csv_npz_and_mat(recording, tmp_path):
    for suffix in (".csv", ".npz", ".mat"):
        assert export(recording, tmp_path / f"t{suffix}", "/slave") == 3
    with (tmp_path / "t.csv").open() as stream:
        header, *rows = csv.reader(stream)
    assert header == ["stamp_ns", "force"]
    assert np.array_equal(np.array(rows, float), ROWS, equal_nan=True)
    with np.load(tmp_path / "t.npz") as table:
        assert np.array_equal(table["force"], ROWS[:, 1], equal_nan=True)
    assert np.array_equal(loadmat(tmp_path / "t.mat")["force"][0], ROWS[:, 1], equal_nan=True)


def test_an_unknown_topic_or_kind_of_file_is_told_with_what_there_is(recording, tmp_path):
    with pytest.raises(RecordingError, match="it has: /slave"):
        export(recording, tmp_path / "t.csv", "/master")
    with pytest.raises(RecordingError, match=r"one of: \.csv"):
        export(recording, tmp_path / "t.xlsx", "/slave")
