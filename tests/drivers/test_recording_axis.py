from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from teleop_rt.axis import AxisError, EndOfRecording, Sample
from teleop_rt.config.loader import load_rig
from teleop_rt_drivers.opening import open_axis
from teleop_rt_drivers.recording import RecordingAxis
from teleop_rt_drivers.registry import AXIS_SCHEMAS

SPRING_RIG = Path(__file__).parents[2] / "config" / "rigs" / "measured_spring.yaml"
needs_data = pytest.mark.skipif(
    "TELEOP_RT_DATA" not in os.environ, reason="TELEOP_RT_DATA is not set: no measured data"
)


def recording(tmp_path, text: str, **changes) -> RecordingAxis:
    file = tmp_path / "run.csv"
    file.write_text(text)
    return axis_of(str(file), **changes)


def axis_of(file: str, rate_hz: int = 1000, **changes) -> RecordingAxis:
    rig = load_rig(SPRING_RIG, AXIS_SCHEMAS)
    columns = {"position_column": "x_mm", "force_column": "F", **changes}
    config = rig.axis.model_copy(update={"file": file, **columns})
    rig = rig.model_copy(update={"rate_hz": rate_hz, "axis": config})
    axis = open_axis(rig, lambda: 5_000_000_000)
    assert isinstance(axis, RecordingAxis)
    return axis


GOOD = "t_s,x_mm,F\n2.000,1.0,-3.0\n2.001,2.0,-4.0\n2.002,4.0,-5.0\n"


def test_samples_are_played_one_by_one_scaled_and_stamped_on_the_files_time(tmp_path):
    axis = recording(tmp_path, GOOD, position_scale=1e-3, force_scale=-2.0, force_offset=1.0)
    axis.configure()
    sample, played = Sample(), []
    for _ in range(3):
        axis.read_into(sample)
        assert sample.valid
        played.append((sample.stamp_ns, sample.position, sample.force))
        axis.write(0.5)
    stamps, positions, forces = zip(*played, strict=True)
    assert stamps == (5_000_000_000, 5_001_000_000, 5_002_000_000)
    assert positions == pytest.approx((0.001, 0.002, 0.004))
    assert forces == pytest.approx((7.0, 9.0, 11.0))
    assert axis.counters == {"samples_played": 3, "commands_ignored": 3}


def test_the_end_is_said_after_the_last_sample(tmp_path):
    axis = recording(tmp_path, GOOD)
    axis.configure()
    sample = Sample()
    for _ in range(3):
        axis.read_into(sample)
    with pytest.raises(EndOfRecording, match="3 samples"):
        axis.read_into(sample)
    assert sample.position == 4.0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("t_s,x_mm\n0,1\n0.001,2\n", "no column 'F'; it has: t_s, x_mm"),
        ("t_s,x_mm,F\n0,1,2\n0.001,1,2\n0.001,1,2\n", "line 4: time does not increase"),
        ("t_s,x_mm,F\n0,1,2\n0.001,1,nan\n", "line 3, column 'F': not a number"),
        ("t_s,x_mm,F\n0,1,2\n0.001,1,oops\n", "not a table of numbers"),
        ("t_s,x_mm,F\n0,1,2\n", "fewer than two samples"),
        ("t_s,x_mm,F\n0,1,2\n0.0005,1,2\n0.001,1,2\n", "2000 Hz.*1000 Hz"),
        ("t_s,x_mm,F\n0,1,2\n0.0004,1,2\n0.002,1,2\n", "line 4: a gap of 1.6 ms"),
        ("", "no column 't_s'"),
    ],
)
def test_a_file_that_cannot_be_played_is_refused_with_the_place(tmp_path, text, said):
    with pytest.raises(AxisError, match=said):
        recording(tmp_path, text).configure()


def test_a_rate_within_a_thousandth_is_played(tmp_path):
    rows = "\n".join(f"{k * 1.0009e-3:.9f},0,0" for k in range(100))
    axis = recording(tmp_path, f"t_s,x_mm,F\n{rows}\n")
    axis.configure()
    assert len(axis) == 100


def test_an_unset_variable_is_named(monkeypatch):
    monkeypatch.delenv("TELEOP_RT_DATA", raising=False)
    with pytest.raises(AxisError, match="environment variable TELEOP_RT_DATA is not set") as said:
        axis_of("${TELEOP_RT_DATA}/a/x.csv").configure()
    assert "the folder that holds a/x.csv, a table with the columns t_s, x_mm, F" in str(said.value)
    assert "docs/measured.md names its source" in str(said.value)


def test_a_missing_file_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("TELEOP_RT_DATA", str(tmp_path))
    with pytest.raises(AxisError, match=r"x\.csv: no such file"):
        axis_of("${TELEOP_RT_DATA}/x.csv").configure()


def test_stop_and_close_may_be_called_at_any_time(tmp_path):
    axis = recording(tmp_path, GOOD)
    axis.stop()
    axis.close()
    axis.configure()
    axis.stop()


@needs_data
def test_the_measured_spring_is_played_whole_with_its_signs():
    rig = load_rig(SPRING_RIG, AXIS_SCHEMAS)
    axis = open_axis(rig, lambda: 0)
    axis.configure()
    sample, played = Sample(), []
    for _ in range(len(axis)):
        axis.read_into(sample)
        played.append((sample.stamp_ns, sample.position, sample.force))
    with pytest.raises(EndOfRecording):
        axis.read_into(sample)
    stamps, positions, forces = np.array(played).T
    assert len(stamps) > 8000
    assert np.ptp(np.diff(stamps)) <= 2
    assert np.median(np.diff(stamps)) == 500_000
    slope = np.polyfit(positions, forces, 1)[0]
    assert slope == pytest.approx(3.61, abs=0.05)
