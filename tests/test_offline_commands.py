import errno
import json
import os
import re
from contextlib import closing
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from teleop_rt.diagnosis.models.base import MODELS, TERMS
from teleop_rt.extras import install_command
from teleop_rt.offline import work
from teleop_rt.offline.commands import size_seen
from teleop_rt.realtime.recording import RecordingWriter
from teleop_rt.section import Units
from teleop_rt.signals import Signal
from teleop_rt_dev.paths import SILICONE

DATA = os.environ.get("TELEOP_RT_DATA")


def press(duration_s=6.0, rate_hz=1000, noise=0.05, seed=1):
    """A Kelvin-Voigt body, k = 1500, b = 50, surface at 10 mm, pressed with lift-offs."""
    t = np.arange(round(duration_s * rate_hz)) / rate_hz
    x = 0.004 + 0.01 * np.sin(2 * np.pi * 1.3 * t) + 0.004 * np.sin(2 * np.pi * 3.1 * t)
    v = np.gradient(x, t)
    force = np.where(x > 0, np.maximum(0.0, 1500 * x + 50 * v), 0.0)
    force += np.random.default_rng(seed).normal(0, noise, t.size)
    return t, 0.010 + np.round(x / 5e-6) * 5e-6, force


def write_csv(path, t, position, force, header="t_s,position_m,force_N"):
    np.savetxt(path, np.c_[t, position, force], delimiter=",", header=header, comments="")
    return path


def row_of(answer, *names):
    keys = ("model", "regression", "solver")
    (row,) = (row for row in answer["estimators"] if tuple(row[k] for k in keys) == names)
    return row


def test_replay_finds_the_body_in_a_plain_csv_mat_and_npz(call, tmp_path):
    t, position, force = press()
    files = [write_csv(tmp_path / "a.csv", t, position, force)]
    np.savez(tmp_path / "a.npz", t_s=t, position_m=position, force_N=force)
    savemat(tmp_path / "a.mat", {"t_s": t, "position_m": position, "force_N": force})
    files += [tmp_path / "a.npz", tmp_path / "a.mat"]
    code, out, err = call("replay", *files, "--models", "kelvin-voigt", "--json")
    assert (code, err) == (0, "")
    answers = [json.loads(line) for line in out.splitlines()]
    assert [answer["recording"] for answer in answers] == [str(file) for file in files]
    for answer in answers:
        assert answer["samples"] == t.size
        parameters = row_of(answer, "kelvin-voigt", "direct", "rls")["parameters"]
        assert parameters["k"]["value"] == pytest.approx(1500, rel=0.02)
        assert parameters["b"]["value"] == pytest.approx(50, rel=0.05)
    assert answers[0]["estimators"] == answers[1]["estimators"]


ALONE = ("--jobs", "1")
"""In this process: to start others takes longer than the work."""


@pytest.mark.usefixtures("no_pages")
def test_replay_of_a_run_gives_its_very_estimates_and_a_trace(call, tmp_path):
    arguments = ("--clock", "simulated", "--duration", 4, "--json", "--out", "run")
    summary = json.loads(call("run", SILICONE, *arguments)[1])
    code, out, _ = call("replay", "run/recording.mcap", "--json", "--trace", "theta.npz")
    answer = json.loads(out)
    assert code == 0
    assert answer["estimators"] == summary["estimators"]
    assert answer["selected"] == summary["selected"]
    of_folder = json.loads(call("replay", "run", "--json")[1])
    assert of_folder["estimators"] == answer["estimators"]
    with np.load(tmp_path / "theta.npz") as trace:
        last = trace["kelvin-voigt/direct/rls/k"][-1]
        assert trace["t_s"].size == answer["samples"]
    value = row_of(answer, "kelvin-voigt", "direct", "rls")["parameters"]["k"]["value"]
    assert last == pytest.approx(value, rel=1e-12)


def test_one_flag_takes_several_pairs_and_a_file_after_them(call, tmp_path):
    t, x, f = press()
    path = write_csv(tmp_path / "a.csv", t, 1e3 * x, -f, "clock,place,pull")
    odd = write_csv(tmp_path / "k=1500.csv", t, 1e3 * x, -f, "clock,place,pull")
    pairs = ("--columns", "time=clock", "position=place", "force=-pull", "--units", "position=mm")
    asked = ("--models", "kelvin-voigt", "--json")
    for arguments in ((path, *pairs, *asked), (*asked, *pairs, odd), (path, *pairs, odd, *asked)):
        code, out, err = call("replay", *arguments)
        assert (code, err) == (0, "")
        for answer in map(json.loads, out.splitlines()):
            row = row_of(answer, "kelvin-voigt", "direct", "rls")
            assert row["parameters"]["k"]["value"] == pytest.approx(1500, rel=0.02)
    assert len(out.splitlines()) == 2


def test_replay_explains_its_order_and_ends_no_line_in_a_blank(call, tmp_path):
    good = write_csv(tmp_path / "good.csv", *press())
    code, out, err = call("replay", good, "--models", "hunt-crossley", "--regressions", "direct")
    assert (code, err) == (0, "")
    first, *lines = out.splitlines()
    assert first.endswith("selected on-line (*), then identified, then the others, each by NRMSE")
    assert any(line.startswith("      n = ") for line in lines)
    assert [line for line in lines if line != line.rstrip()] == []


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


def test_a_surface_may_have_a_unit(call, tmp_path):
    good = write_csv(tmp_path / "good.csv", *press())
    for command in ("replay", "diagnose"):
        code, _, err = call(command, good, "--surface", "10")
        assert code == 2
        assert "--surface takes m, or a unit as in 10mm" in err
    answers = [
        json.loads(call("replay", good, "--surface", text, "--json", "--models", "kelvin-voigt")[1])
        for text in ("10mm", "1e-2", "0.01 m")
    ]
    assert answers[0]["estimators"] == answers[1]["estimators"] == answers[2]["estimators"]


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
        ("kelvin", "unknown base 'kelvin': take one of mass"),
        ("mass,contact-mass", "more than one of its terms has the parameter m"),
    ],
)
def test_a_base_that_cannot_be_is_refused(call, tmp_path, base, message):
    code, out, err = call("diagnose", write_csv(tmp_path / "a.csv", *press()), "--base", base)
    assert (code, out) == (2, "")
    assert message in err


@pytest.fixture
def unusable(tmp_path):
    """Give what stands where a recording is wanted, with the words for each."""
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
        "empty.mcap": "empty.mcap: is empty",
        "empty.csv": "empty.csv: is empty",
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


RECOVERED = (
    "2 messages, 1.500 s of the run, saved in cut/recording.recovered.mcap; what was recorded after"
    " them is lost\n"
)


def test_recover_and_export_take_the_folder_of_a_run(call, tmp_path):
    (tmp_path / "run").mkdir()
    recording = tmp_path / "run" / "recording.mcap"
    with closing(RecordingWriter(recording, Units(position="m", force="N"))) as writer:
        writer.add_topic("/one", [Signal("stamp_ns", "ns", "when")])
        writer.write_rows("/one", np.array([[1.0], [1.5e9 + 1.0]]))
    code, out, err = call("recover", "run")
    assert (code, err) == (0, "")
    assert out == "run/recording.mcap is whole, with 2 messages: nothing to recover\n"
    assert list((tmp_path / "run").iterdir()) == [recording], "an intact recording gets no copy"
    (tmp_path / "cut").mkdir()
    (tmp_path / "cut" / "recording.mcap").write_bytes(recording.read_bytes()[:-40])
    code, out, err = call("recover", "cut")
    assert (code, out, err) == (0, RECOVERED, "")
    assert call("export", "run", "one.csv", "--topic", "/one")[0] == 0
    code, _, err = call("export", "run", "one.csv", "--topic", "/one")
    assert (code, err) == (2, "one.csv: already exists: name another file, or remove it\n")
    code, _, err = call("export", "run", "none/one.csv", "--topic", "/one")
    assert code == 2
    assert "none/one.csv: cannot be written: No such file or directory" in err


def test_diagnose_reports_a_class_with_deviations_and_the_motion_that_would_decide(call, tmp_path):
    t = np.arange(0.0, 5.0, 2e-3)
    x = 0.006 - 0.004 * np.cos(2 * np.pi * 1.5 * t)
    late = np.interp(t - 4e-3, t, 900.0 * x + 12.0 * np.gradient(x, t))
    force = late + np.random.default_rng(4).normal(0, 0.01, t.size)
    recording = write_csv(tmp_path / "a.csv", t, x, force, header="t,x_m,F")
    code, out, _ = call("diagnose", recording, "--surface", "0")
    first, base, effect, words, *rest = out.splitlines()
    assert (code, first) == (0, f"{recording}: class")
    assert re.match(r"  kelvin-voigt \(base\): k = .*\d ± \d.*b = .*\d ± \d", base)
    assert re.match(r"  \w+ \(\w+\): .*\d ± \d", effect)
    assert re.match(r"    The .* -?\d.*\.$", words), "the law, in a sentence with its figures"
    assert [line.split(":")[0].split(" on ")[0] for line in rest] == [
        "  one of",
        "  NRMSE",
        "  to decide",
    ]


def test_the_help_of_diagnose_lists_models_and_terms(call):
    code, out, _ = call("diagnose", "--help")
    words = set(re.sub(r"[^a-z-]+", " ", out).split())
    assert code == 0
    assert {*MODELS, *TERMS} <= words


def test_diagnose_says_that_nothing_is_missing_where_nothing_is(call, tmp_path):
    recording = write_csv(tmp_path / "clean.csv", *press(noise=0.2))
    code, out, _ = call("diagnose", recording, "--json", "--surface", "0.010")
    answer = json.loads(out)
    assert code == 0
    assert answer["verdict"] == "no_missing_effect"
    assert answer["effects"] == answer["class"] == []
    assert answer["base"]["parameters"]["k"]["value"] == pytest.approx(1500, rel=0.02)
    assert set(answer["error"]) >= {"metric", "on", "before", "after", "noise_floor"}


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


@pytest.mark.usefixtures("no_pages")
def test_what_is_written_of_recordings_of_one_name_is_kept_apart(call, tmp_path):
    folders = [tmp_path / name for name in ("soft", "hard")]
    for folder, gain in zip(folders, (1.0, 2.0), strict=True):
        folder.mkdir()
        t, position, force = press(noise=0.2)
        write_csv(folder / "a.csv", t, position, gain * force)
    files = [folder / "a.csv" for folder in folders]
    code, _, err = call("diagnose", *files, "--surface", "0.010", "--out", "given", *ALONE)
    assert (code, err.splitlines()) == (
        0,
        [f"no page: `{install_command('report')}` adds it to the next one"],
    )
    stiffness = [
        yaml.safe_load((tmp_path / "given" / name / "model.yaml").read_text())["base"]
        for name in ("a", "a-2")
    ]
    assert [each["parameters"]["k"] for each in stiffness] == pytest.approx([1500, 3000], rel=0.02)
    assert (
        call("replay", *files, "--models", "kelvin-voigt", "--trace", "theta.npz", *ALONE)[0] == 0
    )
    assert {path.name for path in tmp_path.glob("*.npz")} == {"theta-a.npz", "theta-a-2.npz"}


@pytest.mark.usefixtures("no_pages")
def test_what_is_written_of_runs_bears_the_names_of_their_folders(call, tmp_path):
    arguments = ("--clock", "simulated", "--duration", 1, "--json")
    for name in ("first", "second"):
        assert call("run", SILICONE, *arguments, "--out", name)[0] == 0
    runs = ("first", "second/recording.mcap")
    assert call("replay", *runs, "--models", "kelvin-voigt", "--trace", "theta.npz", *ALONE)[0] == 0
    assert {path.name for path in tmp_path.glob("*.npz")} == {"theta-first.npz", "theta-second.npz"}


def test_missing_samples_are_counted_where_the_answer_is_read(call, tmp_path):
    t, position, force = press(noise=0.2)
    kept = np.ones(t.size, dtype=bool)
    kept[[1000, 1001, 3000]] = False
    recording = write_csv(tmp_path / "a.csv", t[kept], position[kept], force[kept])
    code, out, _ = call("diagnose", recording, "--surface", "0.010")
    assert code == 0
    assert "  3 samples missing in 2 gaps" in out.splitlines()


def test_a_cell_of_text_is_named_by_line_and_column_and_counted_as_missing(call, tmp_path):
    recording = write_csv(tmp_path / "a.csv", *press(noise=0.2))
    lines = recording.read_text().splitlines()
    time, position, _ = lines[1001].split(",")
    lines[1001] = f"{time},{position},OL"
    recording.write_text("\n".join(lines) + "\n")
    code, out, err = call("diagnose", recording, "--surface", "0.010")
    assert code == 0
    name = lines[0].lstrip("# ").split(",")[2]
    assert f"{recording}: line 1002, column {name!r}: 'OL' is no number: counted as missing" in err
    assert "  1 sample missing in 1 gap" in out.splitlines()


def test_a_folder_to_write_that_is_a_file_is_refused_before_any_work(call, tmp_path):
    recording = write_csv(tmp_path / "a.csv", *press())
    for place in (recording, recording / "below"):
        code, out, err = call("diagnose", recording, "--out", place)
        assert (code, out) == (2, "")
        assert f"{recording}: is a file" in err


def test_what_the_system_refuses_to_write_is_named_with_its_reason(call, tmp_path, monkeypatch):
    recording, place = write_csv(tmp_path / "a.csv", *press()), tmp_path / "full"

    def refused(*_given):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(place))

    monkeypatch.setattr(work, "write_diagnosis", refused)
    code, out, err = call("diagnose", recording, "--surface", "0.010", "--out", place)
    assert (code, out) == (2, "")
    assert f"{place}: cannot be read or written: No space left on device" in err


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


@pytest.mark.usefixtures("no_pages")
def test_export_and_recover_work_from_the_command_line(call, tmp_path):
    arguments = ("--clock", "simulated", "--duration", 0.5, "--json", "--out", "run")
    assert call("run", SILICONE, *arguments)[0] == 0
    recording = tmp_path / "run" / "recording.mcap"
    code, out, _ = call("export", recording, "t.csv", "--topic", "/master")
    assert (code, out.split()[1]) == (0, "rows")
    (tmp_path / "cut.mcap").write_bytes(recording.read_bytes()[:-5000])
    code, out, _ = call("recover", "cut.mcap")
    assert code == 0
    assert (tmp_path / "cut.recovered.mcap").exists()
    code, _, err = call("export", recording, "u.csv", "--topic", "/nothing")
    assert code == 2
    assert "it has: " in err


@pytest.mark.skipif(DATA is None, reason="TELEOP_RT_DATA is not set")
@pytest.mark.parametrize("name", ["run_a_foam", "run_a_spring", "run_a_rigid", "run_c_spring"])
def test_measured_runs_replay_without_a_fault(call, name):
    file = f"{DATA}/tue_teleop/{name}.csv"
    code, out, err = call("replay", file, "--columns", "position=xs_rad,force=Fe_Nm", "--json")
    assert (code, err) == (0, "")
    answer = json.loads(out)
    assert len(answer["estimators"]) >= 40
    json.dumps(answer, allow_nan=False)


def test_replay_prints_the_best_few_sorted_and_all_when_asked(call, tmp_path):
    t = np.arange(0.0, 5.0, 1e-3)
    x = 0.01 * np.sin(2 * np.pi * 1.1 * t) + 0.002
    force = np.where(x > 0, np.maximum(2500.0 * x + 12.0 * np.gradient(x, t), 0.0), 0.0)
    np.savez(tmp_path / "wall.npz", t_s=t, position_m=x, force_N=force)
    code, out, _ = call("replay", "wall.npz", "--solvers", "rls")
    lines = [line for line in out.splitlines() if ", NRMSE " in line]
    assert code == 0
    assert lines[0].startswith("* kelvin-voigt, ")
    assert "not identified" not in out.partition("mass-spring-damper")[0]
    assert len(lines) == 5
    assert "more: --all prints them" in out
    every = call("replay", "wall.npz", "--solvers", "rls", "--all")[1]
    rows = [line for line in every.splitlines() if ", NRMSE " in line]
    assert rows[:5] == lines
    assert len(rows) == 9
    assert not any(row.lstrip().startswith("mass,") for row in lines)
    assert rows[-1].startswith("  mass-spring-damper, direct, rls: warming up")


def test_a_size_that_would_have_been_detected_has_its_unit_with_the_values_in_it():
    drag = {"name": "air_drag", "size": 2.0, "unit": "N/m^power", "shape": {"power": 1.5}}
    assert size_seen(drag) == "air drag 2 N/m^1.5"
    assert size_seen(drag | {"unit": "N"}) == "air drag 2 N"
    share = {"name": "set", "size": 0.01, "unit": "1", "shape": {}}
    assert size_seen(share) == "set 0.01 (ratio)"


def test_sizes_that_would_have_been_detected_are_two_columns_below_all_else(call, tmp_path):
    recording = write_csv(tmp_path / "clean.csv", *press(noise=0.2))
    code, out, _ = call("diagnose", recording, "--surface", "0.010")
    lines = out.splitlines()
    assert code == 0
    assert "no missing effect" in lines[0]
    (heading,) = [n for n, line in enumerate(lines) if "would have been detected" in line]
    rows = lines[heading + 1 :]
    assert len(rows) > 5
    assert all(line.startswith("    ") and len(line) < 100 for line in rows)
    assert any(line.lstrip().startswith("adhesion ") for line in rows)
    places = {line.rindex("   ") for line in rows[:-1]}
    assert len(places) == 1, "the second column begins at one place"


def test_a_base_that_explains_all_is_printed_before_what_a_wrong_one_lacks(call, tmp_path):
    recording = write_csv(tmp_path / "a.csv", *press())
    wrong = ("--surface", "0.010", "--base", "kelvin-voigt-unilateral")
    code, out, _ = call("diagnose", recording, *wrong)
    _, base, note, *rest = out.splitlines()
    assert code == 0
    assert base.startswith("  kelvin-voigt-unilateral (base): ")
    assert note.startswith("  note: the base kelvin-voigt without any effect predicts this force")
    assert any("direction_dependent_damping" in line for line in rest)
    assert not any("the base kelvin-voigt without" in line for line in rest)
