"""Recordings as Parquet and as LeRobot datasets: written without LeRobot, held to its format."""

from __future__ import annotations

import json
import sys

import numpy as np
import pytest
from jsonschema import validate

from teleop_rt.config.section import Units
from teleop_rt.errors import RecordingError
from teleop_rt.outputs import OutputError
from teleop_rt.realtime.export import export
from teleop_rt.realtime.lerobot import export_lerobot
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.signals import SLAVE, columns

parquet = pytest.importorskip("pyarrow.parquet")
START_NS, PERIOD_NS = 10**12, 2_000_000

# Of format 2.1, as huggingface/lerobot documents and datasets on its hub have it.
FEATURE = {
    "type": "object",
    "required": ["dtype", "shape", "names"],
    "properties": {
        "dtype": {"enum": ["float32", "int64"]},
        "shape": {"type": "array", "items": {"type": "integer", "minimum": 1}},
        "names": {"type": ["array", "null"], "items": {"type": "string"}},
    },
}
WHOLE = {"type": "integer", "minimum": 0}
INFO = {
    "type": "object",
    "required": [
        "codebase_version", "robot_type", "total_episodes", "total_frames", "total_tasks",
        "total_videos", "total_chunks", "chunks_size", "fps", "splits", "data_path", "video_path",
        "features",
    ],
    "properties": {
        "codebase_version": {"const": "v2.1"},
        "robot_type": {"type": ["string", "null"]},
        **dict.fromkeys(("total_episodes", "total_frames", "total_tasks", "chunks_size"), WHOLE),
        "total_videos": {"const": 0},
        "fps": {"type": "integer", "minimum": 1},
        "splits": {"type": "object", "required": ["train"]},
        "data_path": {
            "const": "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
        },
        "video_path": {"type": "null"},
        "features": {
            "type": "object",
            "required": ["timestamp", "frame_index", "episode_index", "index", "task_index"],
            "additionalProperties": FEATURE,
        },
    },
}  # fmt: skip


def recorded(path, ticks=501, position="m", force="N", skipped=()):
    """A slave at 500 Hz whose position counts its ticks; some ticks are missing."""
    place = columns(SLAVE)
    rows = np.zeros((ticks, len(SLAVE)))
    tick = np.arange(ticks)
    rows[:, place["stamp_ns"]] = rows[:, place["sample_stamp_ns"]] = START_NS + PERIOD_NS * tick
    rows[:, place["position"]] = 1e-4 * tick
    rows[:, place["velocity"]] = 0.05
    rows[:, place["force"]] = 0.01 * tick
    rows[:, place["target"]] = 1e-4 * tick + 1.0
    rows[:, place["valid"]] = 1.0
    rows[100:110, place["valid"]] = 0.0
    rows[200:201, place["force"]] = np.nan
    path.parent.mkdir(parents=True, exist_ok=True)
    writer = RecordingWriter(path, Units(position=position, force=force), {})
    writer.add_topic("/slave", SLAVE)
    writer.write_rows("/slave", np.delete(rows, list(skipped), axis=0))
    writer.close()
    return path


def lines(file):
    return [json.loads(line) for line in file.read_text().splitlines()]


def test_a_topic_is_exported_as_parquet_with_units_in_its_names(tmp_path):
    out = tmp_path / "t.parquet"
    assert export(recorded(tmp_path / "r.mcap"), out, "/slave") == 501
    table = parquet.read_table(out)
    assert table.column("position_m").to_pylist() == pytest.approx(1e-4 * np.arange(501))
    assert table.column("tick").type == "int64"
    assert np.isnan(table.column("force_N").to_numpy()[200])


def assert_columns_are_as_declared(table, features):
    for name, feature in features.items():
        kind, size = table.schema.field(name).type, feature["shape"][0]
        one = kind if size == 1 else kind.value_type
        assert str(one) == {"float32": "float", "int64": "int64"}[feature["dtype"]]
        assert getattr(kind, "list_size", 1) == size


def test_two_recordings_are_two_episodes_of_a_dataset_as_it_is_published(tmp_path):
    paths = [
        recorded(tmp_path / "a" / "recording.mcap", skipped=range(300, 304)),
        recorded(tmp_path / "b" / "recording.mcap", ticks=251),
    ]
    out = tmp_path / "set"
    assert export_lerobot(paths, out, "press", 50) == 51 + 26
    info = json.loads((out / "meta" / "info.json").read_text())
    validate(info, INFO)
    assert (info["total_episodes"], info["total_frames"], info["fps"]) == (2, 77, 50)
    assert info["features"]["observation.state"]["names"] == [
        "position_m",
        "velocity_m_per_s",
        "force_N",
    ]
    assert lines(out / "meta" / "tasks.jsonl") == [{"task_index": 0, "task": "press"}]
    assert lines(out / "meta" / "episodes.jsonl") == [
        {"episode_index": 0, "tasks": ["press"], "length": 51},
        {"episode_index": 1, "tasks": ["press"], "length": 26},
    ]
    index = 0
    for number, length in enumerate((51, 26)):
        path = info["data_path"].format(episode_chunk=0, episode_index=number)
        table = parquet.read_table(out / path)
        assert set(table.column_names) == set(info["features"])
        assert_columns_are_as_declared(table, info["features"])
        frame = np.arange(length)
        assert table.column("timestamp").to_numpy() == pytest.approx(frame / 50, abs=1e-6)
        assert table.column("frame_index").to_pylist() == frame.tolist()
        assert table.column("index").to_pylist() == (frame + index).tolist()
        assert set(table.column("episode_index").to_pylist()) == {number}
        # A frame is every tenth tick, or the last valid one before it.
        ticks = np.array([{10: 99, 20: 199}.get(k, 10 * k) for k in frame])
        ticks[(ticks == 300) & (number == 0)] = 299
        state = np.array(table.column("observation.state").to_pylist())
        assert state[:, 0] == pytest.approx(1e-4 * ticks, abs=1e-7)
        assert state[:, 2] == pytest.approx(0.01 * ticks, abs=1e-6)
        action = np.array(table.column("action").to_pylist())
        assert action == pytest.approx(1e-4 * ticks + 1.0, abs=1e-6)
        index += length


def test_statistics_are_those_of_the_frames(tmp_path):
    out = tmp_path / "set"
    export_lerobot([recorded(tmp_path / "r.mcap")], out, "press", 100)
    (stats,) = lines(out / "meta" / "episodes_stats.jsonl")
    table = parquet.read_table(next(out.glob("data/*/*.parquet")))
    assert set(stats["stats"]) == set(table.column_names)
    state = np.array(table.column("observation.state").to_pylist())
    found = stats["stats"]["observation.state"]
    for name, value in (
        ("min", state.min(axis=0)),
        ("max", state.max(axis=0)),
        ("mean", state.mean(axis=0)),
        ("std", state.std(axis=0)),
    ):
        assert found[name] == pytest.approx(value, abs=1e-6)
    assert found["count"] == [len(state)] == [101]


def test_what_cannot_be_written_is_refused(tmp_path, monkeypatch):
    path, filled = recorded(tmp_path / "r.mcap"), tmp_path / "filled"
    rotary = recorded(tmp_path / "rotary.mcap", position="rad", force="Nm")
    short = recorded(tmp_path / "short.mcap", ticks=5)
    with pytest.raises(RecordingError, match="different units"):
        export_lerobot([path, rotary], tmp_path / "new", "press", 50)
    with pytest.raises(RecordingError, match="no two frames"):
        export_lerobot([short], tmp_path / "new", "press", 50)
    filled.mkdir()
    (filled / "mine").touch()
    with pytest.raises(OutputError, match="is not empty"):
        export_lerobot([path], filled, "press", 50)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(RecordingError, match=r"pip install .pyarrow"):
        export_lerobot([path], tmp_path / "new", "press", 50)
    with pytest.raises(RecordingError, match=r"pip install .pyarrow"):
        export(path, tmp_path / "t.parquet", "/slave")
    assert not (tmp_path / "new").exists()
    assert not (tmp_path / "t.parquet").exists()


def test_the_command_writes_a_folder_of_runs(tmp_path, call):
    for name in ("one", "two"):
        recorded(tmp_path / "runs" / name / "recording.mcap", ticks=101)
    code, out, err = call("export", tmp_path / "runs", tmp_path / "set", "--lerobot", "--fps", "25")
    assert code == 0, err
    assert out.startswith("10 frames of 2 episodes in")
