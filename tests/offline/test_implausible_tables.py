"""Replay refuses a table whose unit or sign is wrong, and estimates from one without a grid."""

from __future__ import annotations

import re

import numpy as np
import pytest

import teleop_rt
from teleop_rt.config.section import Units
from teleop_rt.diagnosis.diagnose import diagnose
from teleop_rt.diagnosis.samples.implausible import doubtful_unit
from teleop_rt.errors import RecordingError
from teleop_rt.offline import replay
from teleop_rt.offline.load import load_any
from teleop_rt.offline.replay import Choice, online_of_recording, run_estimators
from teleop_rt.offline.table import Table
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.recordings.recording import from_arrays

RLS = Choice(models=["kelvin-voigt"], regressions=["direct"], solvers=["rls"])
SAMPLES, PERIOD_S = 3000, 0.002


def pressed(seed=1):
    """A tool on 1500 N/m and 8 N s/m that leaves between contacts; positions on no grid."""
    t = PERIOD_S * np.arange(SAMPLES)
    phase = np.array([1.1, 1.49, 3.2])[:, None] * 2.0 * np.pi * t
    position = 0.004 + np.array([6.0e-3, 2.0e-3, 0.9e-3]) @ np.sin(phase)
    velocity = np.gradient(position, t)
    force = np.where(position > 0.0, np.maximum(1500.0 * position + 8.0 * velocity, 0.0), 0.0)
    return t, position, force + np.random.default_rng(seed).normal(0.0, 0.02, SAMPLES)


def online(position, force, choice=RLS):
    return online_of_recording(from_arrays("table", pressed()[0], position, force), choice)


def test_positions_without_a_grid_keep_the_estimate_from_one_contact_to_the_next():
    _, position, force = pressed()
    (row,), selected, *_ = run_estimators(online(position, force))
    found = row["parameters"]["k"]
    assert selected == 0
    assert row["nrmse"] < 0.002
    assert found["identified"]
    assert abs(found["value"] - 1500.0) < min(3.0 * found["std"], 3.0)


def test_millimetres_under_the_name_of_metres_are_refused_with_the_flag_that_helps():
    _, position, force = pressed()
    with pytest.raises(RecordingError, match=r"wrong unit\?.*--units position=mm"):
        online(1e3 * position, force)


@pytest.mark.parametrize(("signs", "column"), [((-1.0, 1.0), "position"), ((1.0, -1.0), "force")])
def test_a_column_of_turned_sign_is_refused_and_named(signs, column):
    _, position, force = pressed()
    with pytest.raises(RecordingError, match=rf"wrong sign\?.*--columns {column}=-NAME"):
        online(signs[0] * position, signs[1] * force)


def test_a_mass_moved_in_the_air_is_no_turned_sign():
    t, position, _ = pressed()
    acceleration = np.gradient(np.gradient(position, t), t)
    moved = online(position - position.max(), 2.0 * acceleration)
    assert moved.position.size == SAMPLES


def test_a_recording_without_its_end_is_read_with_a_note(tmp_path, capsys):
    path = tmp_path / "cut.mcap"
    writer = RecordingWriter(path, Units(position="m", force="N"), {})
    writer.close()
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(RecordingError):
        load_any(path, Table({}, {}, None))
    assert f"{path}: cut off" in capsys.readouterr().err


def test_the_trace_of_a_long_recording_is_thinned_and_the_estimate_is_the_same(monkeypatch):
    _, position, force = pressed()
    recorded = online(position, force)
    (whole,), _, trace, _ = run_estimators(recorded)
    monkeypatch.setattr(replay, "MOST_KEPT", 1_000)
    (row,), _, thinned, _ = run_estimators(recorded)
    assert len(trace.signals) == SAMPLES
    assert 500 < len(thinned.signals) <= 1_000
    assert np.array_equal(thinned.physical(0, "k"), trace.physical(0, "k")[3::4])
    assert row["parameters"] == whole["parameters"]
    assert abs(row["convergence_s"] - whole["convergence_s"]) <= 4 * PERIOD_S


def test_replay_notes_a_travel_and_a_stiffness_that_only_another_unit_makes_plausible(tmp_path):
    t, position, force = pressed()
    for name, factor, read in (("m", 100.0, "in mm"), ("mm", 1.0, "in m"), ("m", 1.0, "")):
        path = tmp_path / "table.csv"
        table = np.column_stack([t, factor * position, force])
        np.savetxt(path, table, delimiter=",", header=f"t_s,position_{name},force_N", comments="")
        notes = replay.replay(path, RLS, Table({}, {}, None))[0]["notes"]
        doubts = [note for note in notes if note.startswith("is the unit right?")]
        assert len(doubts) == bool(read)
        assert all(f"{read} it would be" in one for one in doubts)


@pytest.mark.parametrize(
    ("unit", "travel", "stiffness"), [("m", 0.9, 1500.0), ("m", 2e-5, 0.02), ("rad", 1.5, 3.0)]
)
def test_a_long_way_a_soft_probe_and_an_angle_are_no_doubtful_units(unit, travel, stiffness):
    assert doubtful_unit(unit, travel, stiffness) is None


def test_a_diagnosis_has_the_same_note():
    t, position, force = pressed()
    notes = diagnose(from_arrays("metres", t, 100.0 * position, force), surface=0.0).answer["notes"]
    assert any("read in mm it would be 0.0017 m against 15000 N/m" in note for note in notes)


def test_arrays_of_turned_force_are_refused_as_the_commands_refuse_a_file():
    t, position, force = pressed()
    for surface in (None, 0.0):
        with pytest.raises(RecordingError, match=r"wrong sign\?.*from_arrays takes arrays"):
            teleop_rt.from_arrays(t, position, -force, surface=surface)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 150.0])
def test_a_slow_table_is_replayed_with_a_slower_filter(rate_hz):
    t = np.arange(0.0, 20.0, 1.0 / rate_hz)
    position = 0.004 - 0.008 * np.cos(np.pi * t)
    velocity = 0.008 * np.pi * np.sin(np.pi * t)
    force = np.where(position > 0.0, np.maximum(2000.0 * position + 8.0 * velocity, 0.0), 0.0)
    force += np.random.default_rng(1).normal(0.0, 0.02, t.size)
    slow = online_of_recording(from_arrays("table", t, position, force), RLS)
    (row,), *_ = run_estimators(slow)
    assert row["parameters"]["k"]["value"] == pytest.approx(2000.0, rel=0.01)


def touched(peak_n, *, seconds, noise_n, choice=RLS):
    """One touch of 2000 N/m in 10 s of free air, replayed: the doubt."""
    t = np.arange(0.0, 10.0, PERIOD_S)
    near, since = np.exp(-(((t - 5.0) / 0.3) ** 2)), (t - 5.0) / (0.5 * seconds)
    air = -0.005 + 0.003 * np.sin(np.pi * t)
    position = (1.0 - near) * air + near * peak_n / 2000.0 * np.maximum(1.0 - since**2, -4.0)
    force = 2000.0 * np.maximum(position, 0.0) + np.random.default_rng(1).normal(0, noise_n, t.size)
    return run_estimators(online_of_recording(from_arrays("table", t, position, force), choice))[3]


def test_a_brief_touch_is_a_contact_or_the_note_says_which_one_would_be():
    assert touched(3.0, seconds=0.06, noise_n=0.02) == ""
    noisy = touched(3.0, seconds=0.06, noise_n=0.4)
    assert re.match(r"no contact: one begins with 3 samples \(6 ms\) above 3\.\d+ N, 8 dev", noisy)
    assert re.search(r"but the force rises to 3\.\d+ N and stays above for at most 4 ms; p", noisy)
    assert "rises to 1.57 N; press" in touched(1.0, seconds=0.06, noise_n=0.4)
    air = Choice(models=["mass"], regressions=["direct"], solvers=["rls"])
    assert touched(1.0, seconds=0.06, noise_n=0.4, choice=air) == ""
