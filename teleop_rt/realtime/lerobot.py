"""Write recordings as a LeRobot dataset: a Parquet file for each episode, and its description.

Format 2.1 as huggingface/lerobot publishes it (docs, `meta/info.json` and its neighbours), without
LeRobot. Parquet needs pyarrow (extra `parquet`).
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.errors import RecordingError
from teleop_rt.outputs import refuse_filled
from teleop_rt.realtime.export import parquet_writer, units_of
from teleop_rt.realtime.reading import read_topics
from teleop_rt.signals import SLAVE_TOPIC

VERSION, CHUNK = "v2.1", 1000
STATE = ("position", "velocity", "force")
ACTION = "target"
DATA_PATH = "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"
SCALARS = {
    "timestamp": "float32",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}
"""Columns of one number each, with their types."""

Floats = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Episode:
    """The frames of one recording: state (n, 3) and action (n,): a shape of [1] is no list."""

    state: Floats
    action: Floats


def export_lerobot(recordings: Sequence[Path], folder: Path, task: str, fps: int) -> int:
    """Write the slave's side of recordings as episodes of one dataset; return its frames.

    `observation.state` is position, velocity and force, `action` the position that the master asks
    for, both in the rig's units, as they were at each frame. Raises RecordingError, OutputError.
    """
    refuse_filled(folder, "name another folder")
    write = parquet_writer()
    units = [_units(recording) for recording in recordings]
    if len(set(units)) > 1:
        raise RecordingError(
            f"recordings of different units are not one dataset: {sorted(set(units))}"
            "; export those of one unit at a time"
        )
    episodes = [read_episode(recording, fps) for recording in recordings]
    (folder / "meta").mkdir(parents=True)
    first = 0
    for number, episode in enumerate(episodes):
        columns = _columns(episode, number, first, fps)
        file = folder / DATA_PATH.format(episode_chunk=number // CHUNK, episode_index=number)
        file.parent.mkdir(parents=True, exist_ok=True)
        write(file, columns)
        first += len(episode.state)
    _write_meta(folder / "meta", episodes, task, fps, units[0])
    return first


def read_episode(recording: Path, fps: int) -> Episode:
    """Return the frames of a recording: each is the newest valid sample of its time.

    Raises RecordingError where the recording has no slave's side, or is shorter than two frames.
    """
    columns = read_topics(recording, [SLAVE_TOPIC]).get(SLAVE_TOPIC)
    if columns is None:
        raise RecordingError(
            f"{recording}: has no {SLAVE_TOPIC}: give the recording of a run or of its slave"
        )
    rows = np.stack([columns[name] for name in (*STATE, ACTION)], axis=1)
    known = (columns["valid"] > 0) & np.isfinite(rows).all(axis=1)
    stamps, rows = columns["stamp_ns"][known], rows[known]
    frames = 0 if stamps.size == 0 else int((stamps[-1] - stamps[0]) * 1e-9 * fps + 1e-6) + 1
    if frames < 2:
        raise RecordingError(
            f"{recording}: has no two frames of valid samples at {fps} per second"
            ": give a longer one, or leave it out"
        )
    times = stamps[0] + np.arange(frames) * (1e9 / fps)
    newest = np.searchsorted(stamps, times + 1.0, side="right") - 1
    taken = rows[newest].astype(np.float32)
    return Episode(taken[:, : len(STATE)], taken[:, len(STATE)])


def _units(recording: Path) -> tuple[str, str]:
    """Return the recording's units of position and force."""
    units = units_of(recording, SLAVE_TOPIC)
    return units.get("position", ("m", False))[0], units.get("force", ("N", False))[0]


def _columns(episode: Episode, number: int, first: int, fps: int) -> dict[str, NDArray[np.generic]]:
    """Return the columns of an episode whose first frame is the dataset's `first`."""
    count = np.arange(len(episode.state))
    return {
        "observation.state": episode.state,
        "action": episode.action,
        "timestamp": (count / fps).astype(np.float32),
        "frame_index": count.astype(np.int64),
        "episode_index": np.full(count.size, number, dtype=np.int64),
        "index": (count + first).astype(np.int64),
        "task_index": np.zeros(count.size, dtype=np.int64),
    }


def _write_meta(
    meta: Path, episodes: Sequence[Episode], task: str, fps: int, units: tuple[str, str]
) -> None:
    """Write the metadata: episodes, tasks, features and statistics."""
    lengths = [len(episode.state) for episode in episodes]
    info = _info(lengths, fps, units)
    (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8")
    starts = np.cumsum([0, *lengths])
    _write_lines(meta / "tasks.jsonl", [{"task_index": 0, "task": task}])
    _write_lines(
        meta / "episodes.jsonl",
        [
            {"episode_index": number, "tasks": [task], "length": length}
            for number, length in enumerate(lengths)
        ],
    )
    _write_lines(
        meta / "episodes_stats.jsonl",
        [
            {
                "episode_index": number,
                "stats": _statistics(_columns(episode, number, int(start), fps)),
            }
            for number, (episode, start) in enumerate(zip(episodes, starts, strict=False))
        ],
    )


def _info(lengths: Sequence[int], fps: int, units: tuple[str, str]) -> dict[str, Any]:
    """Return the description of a dataset whose episodes have so many frames each."""
    x, f = units
    names = [f"position_{x}", f"velocity_{x}_per_s", f"force_{f}"]
    features: dict[str, Any] = {
        "observation.state": {"dtype": "float32", "shape": [len(STATE)], "names": names},
        "action": {"dtype": "float32", "shape": [1], "names": [f"{ACTION}_{x}"]},
    }
    features |= {
        name: {"dtype": dtype, "shape": [1], "names": None} for name, dtype in SCALARS.items()
    }
    return {
        "codebase_version": VERSION,
        "robot_type": "teleop-rt",
        "total_episodes": len(lengths),
        "total_frames": sum(lengths),
        "total_tasks": 1,
        "total_videos": 0,
        "total_chunks": -(-len(lengths) // CHUNK),
        "chunks_size": CHUNK,
        "fps": fps,
        "splits": {"train": f"0:{len(lengths)}"},
        "data_path": DATA_PATH,
        "video_path": None,
        "features": features,
    }


def _statistics(columns: dict[str, NDArray[np.generic]]) -> dict[str, Any]:
    """Return minimum, maximum, mean, standard deviation and count of each feature."""
    found = {}
    for name, column in columns.items():
        values = np.asarray(column, dtype=np.float64).reshape(len(column), -1)
        found[name] = {
            "min": values.min(axis=0).tolist(),
            "max": values.max(axis=0).tolist(),
            "mean": values.mean(axis=0).tolist(),
            "std": values.std(axis=0).tolist(),
            "count": [len(values)],
        }
    return found


def _write_lines(file: Path, lines: list[dict[str, Any]]) -> None:
    text = "".join(json.dumps(line) + "\n" for line in lines)
    file.write_text(text, encoding="utf-8")
