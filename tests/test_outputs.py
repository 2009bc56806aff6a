"""No command overwrites a file: each refuses, with cause, place and next step."""

import pytest

from teleop_rt.cli import app
from teleop_rt_dev.trial.files import SILICONE

PRECIOUS = "a year of work"
ONE = ["diagnose", "press.csv", "--surface", "0"]
SIDE = [SILICONE, "--set", "link.slave_port=38211"]
INTO_A_FOLDER = [
    ["run", SILICONE, "--clock", "simulated", "--out"],
    ["close-loop", SILICONE, "--clock", "simulated", "--out"],
    ["close-loop", "--recording", "press.csv", "--test", "press.csv", "--out"],
    ["slave", *SIDE, "--key", "own.key", "--out"],
    ["master", *SIDE, "--key", "own.key", "--out"],
    ["sim", *SIDE, "--out"],
    ["study", "chapter4", "--out"],
    ["study", "noise", "--out"],
    ["study", "time-varying", "--out"],
    ["study", "excitation", "--out"],
    ["study", "approach", "--out"],
    ["study", "delay", "--out"],
    [*ONE, "--out"],
    ["diagnose", "press.csv", "other.csv", "--out"],
    ["replay", "press.csv", "--out"],
    ["replay", "press.csv", "other.csv", "--out"],
    ["report", "one", "--figures"],
]
INTO_A_FILE = [
    (["replay", "press.csv", "--trace"], "kept.npz"),
    (["recover", "run.mcap", "--out"], "kept.mcap"),
    (["export", "run.mcap"], "kept.csv"),
    (["report", "--compare", "one", "two", "--out"], "kept.html"),
    (["keygen"], "link.key"),
    (["new-rig", "--drive", "odrive", "--adapter", "socketcan", "--sensor", "wrench"], "kept.yaml"),
]
WRITES_NOTHING = {
    "check",
    "arm",
    "start",
    "stop",
    "reset",
    "reload",
    "status",
    "doctor",
    "effects",
    "make-safe",
}
KEEPS_THE_OLD = {"calibrate"}  # beside keys of --write: tests/drivers/test_calibration.py
WRITES_NOTHING |= {"live", "runs", "schema"}


@pytest.fixture(autouse=True)
def recordings(tmp_path):
    rows = "\n".join(f"{1e-3 * i},{1e-5 * i},{0.01 * i}" for i in range(2000))
    for name in ("press.csv", "other.csv"):
        (tmp_path / name).write_text(f"t_s,position [m],force [N]\n{rows}\n")
    (tmp_path / "run.mcap").write_bytes(b"cut off" * 100)
    (tmp_path / "own.key").write_text(bytes(range(100, 132)).hex())
    (tmp_path / "own.key").chmod(0o600)


@pytest.mark.parametrize("arguments", INTO_A_FOLDER, ids=lambda words: " ".join(map(str, words)))
def test_a_folder_with_something_in_it_is_refused_and_left_as_it_is(call, tmp_path, arguments):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "model.yaml").write_text(PRECIOUS)
    code, out, err = call(*arguments, "kept")
    assert (code, out) == (2, "")
    assert "kept: is not empty: name another" in err or "kept: holds something other than" in err
    assert f"name another folder with {arguments[-1]}" in err
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["model.yaml"]
    assert (tmp_path / "kept" / "model.yaml").read_text() == PRECIOUS


@pytest.mark.parametrize("arguments", INTO_A_FOLDER, ids=lambda words: " ".join(map(str, words)))
def test_a_folder_below_a_file_is_refused_before_any_work(call, tmp_path, arguments):
    (tmp_path / "kept").write_text(PRECIOUS)
    code, out, err = call(*arguments, "kept/below")
    assert (code, out) == (2, "")
    assert f"kept: is a file: name another folder with {arguments[-1]}" in err
    assert (tmp_path / "kept").read_text() == PRECIOUS


@pytest.mark.parametrize(("arguments", "name"), INTO_A_FILE, ids=str)
def test_a_file_that_is_there_is_refused_and_left_as_it_is(call, tmp_path, arguments, name):
    (tmp_path / name).write_text(PRECIOUS)
    code, out, err = call(*arguments, name)
    assert (code, out) == (2, "")
    assert f"{name}: already exists: name another" in err
    assert (tmp_path / name).read_text() == PRECIOUS


def test_new_files_overwrite_none_and_none_is_written(call, tmp_path):
    (tmp_path / "mine" / "rigs").mkdir(parents=True)
    rig = tmp_path / "mine" / "rigs" / "simulated_canopen.yaml"
    rig.write_text(PRECIOUS)
    code, out, err = call("new", "mine", "--trial", "silicone_cube")
    assert (code, out) == (2, "")
    assert "simulated_canopen.yaml: already exists: name another folder" in err
    assert rig.read_text() == PRECIOUS
    assert not (tmp_path / "mine" / "trials").exists()


def test_a_full_disk_keeps_no_part_of_new_files(call, tmp_path, files_end_at):
    files_end_at(1000)
    code, out, err = call("new", "mine", "--trial", "silicone_cube")
    assert (code, out) == (2, "")
    assert "cannot be made or written: File too large: make room, or name another folder" in err
    assert not (tmp_path / "mine").exists()


def test_a_second_trial_comes_beside_the_first_and_shares_what_is_alike(call, tmp_path):
    assert call("new", "mine", "--trial", "silicone_cube")[0] == 0
    assert call("new", "mine", "--trial", "hidden_layer")[0] == 0
    assert {path.name for path in (tmp_path / "mine" / "trials").iterdir()} == {
        "silicone_cube.yaml", "hidden_layer.yaml"
    }  # fmt: skip
    code, _, err = call("new", "mine", "--trial", "hidden_layer")
    assert code == 2
    assert "hidden_layer.yaml" in err
    assert "already exists: name another folder" in err


def test_of_every_command_it_is_known_whether_it_writes():
    asked = {words[0] for words in INTO_A_FOLDER} | {words[0] for words, _ in INTO_A_FILE}
    assert asked | WRITES_NOTHING | KEEPS_THE_OLD | {"new"} == set(app.commands)
    studies = {words[1] for words in INTO_A_FOLDER if words[0] == "study"}
    assert studies == set(app.load("study").commands)


def test_a_page_is_not_promised_where_a_report_has_its_own_place(call, tmp_path):
    (tmp_path / "one").mkdir()
    code, out, err = call("report", "one", "--out", "page.html")
    assert (code, out) == (2, "")
    assert "--out goes with --compare" in err
