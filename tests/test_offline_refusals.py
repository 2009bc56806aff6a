"""Commands on recordings refuse files that they cannot use, and name the ones to give instead."""

import errno
import json
import os
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from offline_tables import press, write_csv

from teleop_rt.offline import work


def test_a_bad_file_is_reported_and_the_others_are_still_done(call, tmp_path):
    good = write_csv(tmp_path / "good.csv", *press())
    bad = write_csv(tmp_path / "bad.csv", *press(), header="t_s,place,force_N")
    code, out, err = call("replay", bad, "none.csv", good, "--models", "kelvin-voigt", "--json")
    assert code == 2
    first, second, third = (json.loads(line) for line in out.splitlines())
    assert set(first) == set(second) == {"recording", "problem"}
    assert "position" in first["problem"]
    assert "--columns" in first["problem"]
    assert "none.csv" in second["problem"]
    assert third["estimators"]
    assert len(err.splitlines()) == 3
    assert err.splitlines()[-1] == f"2 of 3 recordings have no answer: {bad}, none.csv"


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--models", "maxwell", "unknown model 'maxwell'; one of: mass"),
        ("--models", "kelvin-voigd", "unknown model 'kelvin-voigd'; did you mean 'kelvin-voigt'?"),
        ("--surface", "there", "write auto, or a position such as 0.01 or 10mm"),
        ("--surface", "10parsec", "unknown unit 'parsec' of surface; one of m, cm, mm"),
        ("--columns", "xs_rad", "write ROLE=NAME"),
        ("--rate", "-5", "--rate -5: give samples per second"),
        ("--rate", "400", "good.csv: has a column with times: leave out --rate"),
    ],
)
def test_wrong_options_say_what_is_allowed(call, tmp_path, option, value, message):
    good = write_csv(tmp_path / "good.csv", *press())
    code, _, err = call("replay", good, option, value)
    assert code == 2
    assert message in err


def test_all_missing_columns_are_named_at_once_with_those_that_may_be_meant(call, tmp_path):
    own = write_csv(tmp_path / "own.csv", *press(), header="clock_s,indent_mm,loadcell_X")
    code, _, err = call("diagnose", own)
    assert code == 2
    assert "no column for time, position and force" in err
    assert "--columns time=clock_s position=indent_mm force=loadcell_X" in err


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (bytes(range(256)), "0x81 at 129"),
        (b"\xfc" + b"1,2\n" * 300_000 + b"\x90", "0x90 at 1200001"),
    ],
    ids=["at once", "after a megabyte of a Windows encoding"],
)
def test_a_binary_file_is_called_no_text(call, tmp_path, content, where):
    (tmp_path / "raw.csv").write_bytes(content)
    code, _, err = call("diagnose", "raw.csv")
    assert code == 2
    assert f"cannot be read as .csv: byte {where} belongs to no text" in err


def test_a_folder_that_cannot_be_written_is_refused_before_the_work(call, tmp_path, monkeypatch):
    def refuse(**_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    recording = write_csv(tmp_path / "clean.csv", *press())
    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    monkeypatch.setattr("teleop_rt.offline.work.Diagnosing.answer", None)
    code, out, err = call("diagnose", recording, "--out", "made/here")
    assert (code, out) == (2, "")
    assert "here: cannot be made or written: Read-only file system: name another folder" in err
    assert not (tmp_path / "made").exists()


@pytest.mark.parametrize(
    ("base", "message"),
    [
        ("newton", "unknown base 'newton': take one of mass"),
        (
            "kelvin-voigd",
            "unknown base 'kelvin-voigd': did you mean 'kelvin-voigt'? There are mass",
        ),
        ("mass,contact-mass", "more than one of its terms has the parameter m"),
    ],
)
def test_a_base_that_cannot_be_is_refused(call, tmp_path, base, message):
    code, out, err = call("diagnose", write_csv(tmp_path / "a.csv", *press()), "--base", base)
    assert (code, out) == (2, "")
    assert message in err


@pytest.fixture
def unusable(tmp_path):
    """Give files and folders that are no recording, with the words of each refusal."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder.mcap").mkdir()
    (tmp_path / "empty.mcap").touch()
    (tmp_path / "empty.csv").touch()
    (tmp_path / "binary.mcap").write_bytes(np.random.default_rng(1).bytes(3000))
    return {
        "folder": "folder: a folder without recording.mcap: give a recording",
        "folder.mcap": "folder.mcap: a folder without recording.mcap",
        "none.mcap": "none.mcap: no such file: give a recording",
        "none.csv": "none.csv: no such file",
        "empty.mcap": "empty.mcap: is empty, as after a run that ended at once",
        "empty.csv": "empty.csv: is empty, it has no rows: give another one",
        "binary.mcap": "binary.mcap: not an MCAP recording",
    }


@pytest.mark.parametrize(
    "command",
    [
        ["replay", "{}"],
        ["diagnose", "{}"],
        ["diagnose", "good.csv", "--test", "{}"],
        ["close-loop", "--recording", "{}", "--test", "good.csv"],
        ["close-loop", "--recording", "good.csv", "--test", "{}"],
        ["recover", "{}"],
        ["export", "{}", "out.csv"],
    ],
    ids=lambda words: "-".join(words).strip("-{}"),
)
def test_what_is_no_recording_is_reported_and_nothing_is_written(call, tmp_path, unusable, command):
    write_csv(tmp_path / "good.csv", *press())
    before = sorted(tmp_path.iterdir())
    for name, words in unusable.items():
        code, out, err = call(*(word.format(name) for word in command))
        assert (code, out) == (2, "")
        *phases, problem = err.splitlines()
        assert problem.startswith(words)
        assert "Errno" not in err
        assert phases in ([], [f"reading {command[1].format(name)} ..."])
    assert set(tmp_path.iterdir()) - {tmp_path / "runs"} == set(before)
    assert not list(tmp_path.glob("runs/*"))


def test_a_recording_that_may_not_be_read_is_reported(call, tmp_path, monkeypatch):
    def refuse(*_arguments, **_named):
        raise PermissionError(13, "Permission denied")

    file = write_csv(tmp_path / "closed.csv", *press(1.0))
    monkeypatch.setattr(Path, "open", refuse)
    code, _, err = call("replay", file)
    assert code == 2
    assert "closed.csv: cannot be read: Permission denied: let this user read it" in err


def test_a_surface_that_no_position_reaches_is_refused_with_its_unit(call, tmp_path):
    t = np.arange(0.0, 4.0, 1e-3)
    x = 0.004 - 0.008 * np.cos(7.0 * t)
    np.savez(tmp_path / "a.npz", t_s=t, position_m=x, force_N=np.maximum(2500.0 * x, 0.0))
    code, _, err = call("replay", "a.npz", "--surface", "20")
    assert code == 2
    assert "positions lie between -0.004 and 0.012 m, none beyond the surface at 20 m" in err


@pytest.mark.parametrize(
    ("name", "next_step"),
    [("a.csv", "text in UTF-8"), ("a.mat", "save -v7"), ("a.npz", "numpy.savez")],
)
def test_a_file_of_another_kind_is_reported_with_what_would_be_right(
    call, tmp_path, name, next_step
):
    (tmp_path / name).write_bytes(np.random.default_rng(1).bytes(3000))
    code, _, err = call("replay", name)
    assert code == 2
    assert err.startswith(f"{name}: ")
    assert next_step in err


def test_a_recording_is_refused_as_the_test_of_itself(call, tmp_path):
    recording, out = write_csv(tmp_path / "clean.csv", *press(noise=0.2)), tmp_path / "out"
    copy = tmp_path / "copy.csv"
    copy.write_bytes(recording.read_bytes())
    commands = (["diagnose", recording], ["close-loop", "--recording", recording])
    for command, test in product(commands, (recording, copy)):
        code, result, err = call(*command, "--test", test, "--out", out)
        assert (code, result) == (2, "")
        assert "nothing is held out" in err
        assert not out.exists()


def test_a_folder_to_write_that_is_a_file_is_refused_before_any_work(call, tmp_path):
    recording = write_csv(tmp_path / "a.csv", *press())
    for place in (recording, recording / "below"):
        code, out, err = call("diagnose", recording, "--out", place)
        assert (code, out) == (2, "")
        assert f"{recording}: is a file" in err


def test_what_the_system_refuses_to_write_is_named_with_its_reason(call, tmp_path, monkeypatch):
    recording, place = write_csv(tmp_path / "a.csv", *press()), tmp_path / "full"

    def refused(_found, _recording, _path, folder):
        (folder / "below").mkdir(parents=True)
        (folder / "model.yaml").write_text("base")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(work, "write_diagnosis", refused)
    for there in (False, True):  # a folder that was there before stays, empty
        code, out, err = call("diagnose", recording, "--surface", "0.010", "--out", place / "x")
        assert code == 1
        assert "a.csv: no missing effect" in out
        assert "files in" not in out
        cause = "x: cannot be made or written: No space left on device"
        assert f"{cause}: make room, or name another folder with --out" in err
        assert [path.name for path in tmp_path.glob("full/**/*")] == (["x"] if there else [])
        assert place.exists() == there
        (place / "x").mkdir(parents=True, exist_ok=True)
    code, out, _ = call("diagnose", recording, "--surface", "0.010", "--out", place / "x", "--json")
    assert code == 1
    assert {"verdict", "problem"} <= json.loads(out).keys()


def test_a_held_out_record_in_other_units_is_refused_or_asked_about(call, tmp_path):
    t, position, force = press(noise=0.2)
    recording = write_csv(tmp_path / "a.csv", t, position, force)
    turned = write_csv(tmp_path / "b.csv", t, position, force, "t_s,position_rad,torque_Nm")
    code, out, err = call("diagnose", recording, "--test", turned)
    assert (code, out) == (2, "")
    assert "b.csv, on which its error is to be computed, in rad and Nm" in err
    assert call("close-loop", "--recording", recording, "--test", turned)[0] == 2
    wrong = write_csv(tmp_path / "c.csv", t, position, 1e3 * force)
    arguments = ("--surface", "0.010", "--json", "--test")
    for test, asked in ((wrong, True), (write_csv(tmp_path / "d.csv", *press(seed=2)), False)):
        notes = json.loads(call("diagnose", recording, *arguments, test)[1])["notes"]
        assert any("in the same units?" in note for note in notes) == asked
        assert not any("slow noise" in note for note in notes)


@pytest.mark.parametrize("command", ["replay", "diagnose"])
def test_a_rate_beside_a_column_of_times_is_refused(call, tmp_path, command):
    path = write_csv(tmp_path / "press.csv", *press(1.0))
    code, _, errors = call(command, path, "--rate", 1000)
    assert code == 2
    assert "has a column with times: leave out --rate" in errors


def test_all_unknown_names_are_refused_at_once(call, tmp_path):
    good = write_csv(tmp_path / "good.csv", *press())
    code, _, err = call("replay", good, "--models", "kelvin", "--solvers", "foo")
    assert code == 2
    assert "unknown model 'kelvin'; did you mean 'kelvin-voigt'?" in err
    assert "unknown solver 'foo'; one of: rls" in err
