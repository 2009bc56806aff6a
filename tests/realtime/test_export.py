import csv
import resource
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import loadmat

from teleop_rt.config.schema import LINEAR, ROTARY
from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.outputs import OutputError
from teleop_rt.realtime.export import export, recover
from teleop_rt.realtime.reading import read_metadata, read_topics
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.recordings.layout import columns_of, layout_of
from teleop_rt.recordings.table_files import read_table
from teleop_rt.signals import MASTER, SLAVE, Signal

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
    with pytest.raises(OutputError, match="already exists"):
        recover(cut, tmp_path / "whole.mcap")


def test_a_topic_is_exported_as_csv_npz_and_mat(recording, tmp_path):
    for suffix in (".csv", ".npz", ".mat"):
        assert export(recording, tmp_path / f"t{suffix}", "/slave") == 3
    with (tmp_path / "t.csv").open() as stream:
        header, *rows = csv.reader(stream)
    assert header == ["t_s", "stamp_ns", "force_N"]
    assert rows[1] == ["1.0", "2000000000", "nan"]
    assert np.array_equal(np.array(rows, float)[:, 1:], ROWS, equal_nan=True)
    with np.load(tmp_path / "t.npz") as table:
        assert table["stamp_ns"].dtype == np.int64
        assert np.array_equal(table["force_N"], ROWS[:, 1], equal_nan=True)
    mat = loadmat(tmp_path / "t.mat")
    assert mat["stamp_ns"].dtype == np.int64
    assert np.array_equal(mat["force_N"][0], ROWS[:, 1], equal_nan=True)
    with pytest.raises(OutputError, match="already exists"):
        export(recording, tmp_path / "t.csv", "/slave")


@given(data=st.data())
@settings(max_examples=10, deadline=None)
def test_what_is_exported_is_read_back_as_it_was_recorded(tmp_path_factory, data):
    """Both sides, linear and rotary rigs, all three kinds of files."""
    folder = tmp_path_factory.mktemp("round")
    units = data.draw(st.sampled_from([LINEAR, ROTARY]))
    seed = data.draw(st.integers(0, 2**31))
    rng = np.random.default_rng(seed)
    count = data.draw(st.integers(300, 400))
    first_ns = data.draw(st.integers(0, 10**15))
    recorded = {}
    with closing(RecordingWriter(folder / "r.mcap", units)) as writer:
        for topic, table in (("/slave", SLAVE), ("/master", MASTER)):
            rows = rng.standard_normal((count, len(table)))
            for place, signal in enumerate(table):
                if signal.integer:
                    rows[:, place] = rng.integers(0, 2**40, count)
            names = [signal.name for signal in table]
            rows[:, names.index("stamp_ns")] = first_ns + 1_000_000 * np.arange(count)
            writer.add_topic(topic, table)
            writer.write_rows(topic, rows)
            recorded[topic] = dict(zip(names, rows.T, strict=True))
    force_of = {"/slave": "force", "/master": "rendered_force"}
    for topic, columns in recorded.items():
        for suffix in (".csv", ".npz", ".mat"):
            file = folder / f"{topic[1:]}{suffix}"
            export(folder / "r.mcap", file, topic)
            table = read_table(file)
            assert len(table) == len(columns) + 1, "no two columns have one name"
            for values in columns.values():
                assert any(np.array_equal(values, column) for column in table.values())
            found = columns_of(file, table, layout_of(file))
            assert np.array_equal(found["position"].values, columns["position"])
            assert np.array_equal(found["force"].values, columns[force_of[topic]])
            assert found["position"].rotary == (units.position == "rad")
            stamps = columns["sample_stamp_ns" if topic == "/slave" else "stamp_ns"]
            assert found["time"].values == pytest.approx(1e-9 * stamps, rel=1e-12)
    (folder / "slave.csv").unlink()
    (folder / "slave.columns.yaml").write_text("mine")
    with pytest.raises(OutputError, match=r"slave\.columns\.yaml: already exists"):
        export(folder / "r.mcap", folder / "slave.csv", "/slave")
    assert not (folder / "slave.csv").exists()


def test_a_disk_that_is_full_keeps_no_part_of_a_table(recording, tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (40, before[1]))
    try:
        with pytest.raises(RecordingError, match="cannot be written: File too large"):
            export(recording, tmp_path / "part.csv", "/slave")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert not (tmp_path / "part.csv").exists()


def test_an_unknown_topic_or_kind_of_file_is_reported_with_what_there_is(recording, tmp_path):
    with pytest.raises(RecordingError, match="it has: /slave"):
        export(recording, tmp_path / "t.csv", "/master")
    with pytest.raises(RecordingError, match=r"one of: \.csv"):
        export(recording, tmp_path / "t.xlsx", "/slave")
