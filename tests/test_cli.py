import errno
import json
import logging
import os
import re
import resource
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from typer.core import TyperGroup

from teleop_rt.cli import whole_run
from teleop_rt.extras import install_command
from teleop_rt_drivers import opening, operator_device

README = Path(__file__).parents[1] / "README.md"
TRIALS = Path(__file__).parents[1] / "config" / "trials"
SILICONE = TRIALS / "silicone_cube.yaml"


def changed_trial(folder: Path, old: str, new: str) -> Path:
    text = SILICONE.read_text().replace("../rigs", str(TRIALS.parent / "rigs"))
    assert old in text
    path = folder / "changed.yaml"
    path.write_text(text.replace(old, new))
    return path


def test_a_simulated_run_writes_its_folder_and_prints_one_json_object(call, tmp_path):
    code, out, err = call(
        "run", SILICONE, "--clock", "simulated", "--duration", 2, "--json", "--out", "here"
    )
    assert code == 0
    phases = ["silicone_cube: starting", "reading the recording", "writing the report"]
    assert err.splitlines() == [f"{phase} ..." for phase in phases]
    summary = json.loads(out)
    assert summary == json.loads((tmp_path / "here" / "summary.json").read_text())
    table = README.read_text().partition("| file | contents |")[2].partition("\n\n")[0]
    promised = set(re.findall(r"^\| `([a-z.]+)`", table, re.MULTILINE))
    assert len(promised) == 6
    assert {path.name for path in (tmp_path / "here").iterdir()} == promised


@pytest.mark.usefixtures("no_pages")
def test_the_trial_as_run_runs_again_to_the_same_recording(call, tmp_path):
    again = tmp_path / "first" / "trial.yaml"
    arguments = ("--clock", "simulated", "--duration", 1.5, "--json")
    assert (
        call("run", SILICONE, "--set", "link.round_trip_ms=40", *arguments, "--out", "first")[0]
        == 0
    )
    assert call("run", again, *arguments, "--out", "second")[0] == 0
    first, second = (
        (tmp_path / name / "recording.mcap").read_bytes() for name in ("first", "second")
    )
    assert first == second


@pytest.mark.usefixtures("no_pages")
def test_a_run_without_a_terminal_prints_a_table_with_units(call):
    code, out, err = call("run", SILICONE, "--clock", "simulated", "--duration", 2)
    assert code == 0
    assert err.splitlines()[-1] == f"no report.html: `{install_command('report')}` adds it"
    assert "surface found / true" in out
    assert "N s/m" in out
    assert "files in runs/silicone_cube-" in out


@pytest.mark.usefixtures("no_pages")
def test_a_report_without_its_extra_is_refused_with_what_adds_it(call, tmp_path):
    (tmp_path / "one").mkdir()
    refusal = f"no report: `{install_command('report')}` adds it\n"
    assert call("report", "one") == (2, "", refusal)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["none.yaml"], "none.yaml: no such file"),
        (["."], ".: cannot be read: Is a directory: give a YAML file"),
        ([sys.executable], ": is not text: give a YAML file in UTF-8"),
        ([SILICONE, "--set", "link.loss=2"], "--set link.loss=2: link.loss: must be less"),
        ([SILICONE, "--duration", "-1"], "duration_s: must be greater than or equal to 0.01"),
        ([SILICONE, "--duration", "0"], "--duration 0: duration_s: must be greater"),
        ([SILICONE, "--seed", "-1"], "--seed -1: seed: must be greater"),
        ([SILICONE, "--set", "rig=nowhere.yaml"], "no file"),
        ([SILICONE, "--set", "rig=5"], "--set rig=5: rig: must be"),
        ([SILICONE, "--set", "link.bind_host=1.2.3.4"], "give an address of this machine"),
    ],
)
def test_bad_arguments_give_one_message_and_exit_code_2(call, tmp_path, arguments, message):
    code, out, err = call("run", *arguments)
    assert (code, out) == (2, "")
    assert message in err
    assert len(err.splitlines()) == 1
    assert not (tmp_path / "runs").exists()


def test_a_folder_that_holds_something_is_refused(call, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "thesis.txt").write_text("dear")
    code, _, err = call("run", SILICONE, "--clock", "simulated", "--out", "full")
    assert code == 2
    assert "full: is not empty: name another folder with --out" in err
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["thesis.txt"]


def test_a_folder_that_is_there_but_on_a_read_only_disk_is_refused(call, tmp_path, monkeypatch):
    def refuse(**_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr("tempfile.TemporaryFile", refuse)
    (tmp_path / "here").mkdir()
    code, _, err = call("run", SILICONE, "--clock", "simulated", "--out", tmp_path / "here")
    assert code == 2
    assert "here: cannot be made or written: Read-only file system: name another folder" in err


def test_a_disk_that_takes_no_trial_ends_the_run_with_one_message(call, tmp_path, files_end_at):
    files_end_at(1000)
    code, out, err = call("run", SILICONE, "--clock", "simulated", "--out", tmp_path / "here")
    assert (code, out) == (1, "")
    assert err.startswith("a result: cannot be written: File too large: make room")


def test_a_disk_that_is_full_gets_no_part_of_a_key_or_of_a_rig(call, tmp_path, files_end_at):
    files_end_at(20)
    key, rig = tmp_path / "link.key", tmp_path / "rig.yaml"
    code, out, err = call("keygen", key)
    assert (code, out) == (2, "")
    assert err == f"{key}: cannot write the key: File too large: make room\n"
    devices = ("--drive", "odrive", "--adapter", "socketcan", "--sensor", "drive")
    code, out, err = call("new-rig", rig, *devices)
    assert (code, out) == (1, "")
    assert "File too large: make room" in err
    assert "recording" not in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_an_output_of_few_characters_gets_stand_ins_for_the_others(encoding):
    text = "k = 3600 ± 0.28 N/m ✓ – 漢"
    script = f"from teleop_rt.terminal import pipe_that_may_close as p\nwith p(): print({text!r})"
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, check=True, env=environment
    )
    assert done.stdout == b"k = 3600 +- 0.28 N/m + - ?\n"


def test_a_disk_that_is_full_at_the_summary_loses_none_of_it(
    call, tmp_path, monkeypatch, files_end_at
):
    summarise = whole_run.summarise

    def full_from_now_on(*arguments):
        summary = summarise(*arguments)
        files_end_at(2000)
        return summary

    monkeypatch.setattr(whole_run, "summarise", full_from_now_on)
    folder = tmp_path / "here"
    trial = ("--duration", 0.2, "--clock", "simulated", "--out", folder, "--json")
    code, out, err = call("run", SILICONE, *trial)
    assert code == 1
    assert f"{folder}: summary and report cannot be written: File too large" in err
    assert json.loads(out)["safety"]["state"] == "DISARMED"
    assert sorted(path.name for path in folder.iterdir()) == [
        "log.jsonl", "recording.mcap", "trial.yaml", "truth.json",
    ]  # fmt: skip


def test_a_process_that_may_open_no_further_file_says_how_to_allow_it(call, tmp_path):
    used = len(list(Path("/proc/self/fd").iterdir()))
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (used, before[1]))
    try:
        code, out, err = call("run", SILICONE, "--out", tmp_path / "here")
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert (code, out) == (1, "")
    assert f"a process may open {used} here: raise the limit with `ulimit -n 1024`" in err


def test_a_rig_that_cannot_be_is_reported_before_anything_moves(call, tmp_path):
    trial = changed_trial(tmp_path, "simulated_canopen.yaml", "steam_engine.yaml")
    code, _, err = call("run", trial)
    assert code == 2
    assert "changed.yaml:4: rig: no file" in err


def test_a_port_in_use_is_named(call):
    assert call("keygen", "link.key")[0] == 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        code, _, err = call(
            "slave", SILICONE, "--key", "link.key", "--set", f"link.slave_port={port}",
            "--out", "out",
        )  # fmt: skip
    assert code == 2
    assert f"127.0.0.1:{port}" in err


@pytest.mark.parametrize("side", ["slave", "master"])
def test_a_side_looks_at_its_key_before_it_asks_for_a_port(call, side):
    """The trial that ships has no port: its processes find each other without."""
    code, _, err = call(side, SILICONE, "--key", "missing.key", "--out", "out")
    assert code == 2
    assert "missing.key" in err
    assert "port" not in err


def test_a_run_names_the_bus_that_its_processes_do_not_find(call):
    code, _, err = call(
        "run", SILICONE, "--set", "rig.axis.bus.interface=socketcan",
        "--set", "rig.axis.bus.channel=can7", "--out", "out",
    )  # fmt: skip
    assert code == 2
    assert "can7" in err


def test_a_key_is_made_for_its_owner_alone_and_never_over_another(call, tmp_path):
    code, out, _ = call("keygen", "link.key")
    assert (code, out.splitlines()[0]) == (0, "link.key")
    assert "copy it to both machines" in out
    assert "the folder takes no new files" in call("keygen", "/proc/link.key")[2]
    assert (tmp_path / "link.key").stat().st_mode & 0o777 == 0o600
    before = (tmp_path / "link.key").read_bytes()
    code, _, err = call("keygen", "link.key")
    assert code == 2
    assert "link.key" in err
    assert (tmp_path / "link.key").read_bytes() == before


@pytest.mark.parametrize("side", ["slave", "master"])
def test_a_side_started_alone_needs_a_port_at_which_the_other_finds_it(call, side):
    call("keygen", "link.key")
    code, _, err = call(side, SILICONE, "--key", "link.key", "--out", "out")
    assert code == 2
    assert "silicone_cube.yaml: link.slave_port is 0" in err
    assert "--set link.slave_port=" in err


@pytest.mark.parametrize("side", ["slave", "master"])
@pytest.mark.parametrize(
    ("key", "said"),
    [(None, "name a key file with --key"), ("none", "teleop-rt keygen"), ("open", "chmod 600")],
)
def test_without_a_key_of_its_own_a_side_says_so_and_opens_no_device(
    call, tmp_path, monkeypatch, side, key, said
):
    def opened(*_arguments, **_named):
        raise AssertionError("a device was opened")

    monkeypatch.setattr(opening, "open_axis", opened)
    monkeypatch.setattr(operator_device, "open_device", opened)
    (tmp_path / "open").write_text("00" * 32)
    (tmp_path / "open").chmod(0o644)
    named = [] if key is None else ["--key", key]
    for port in (["--set", "link.slave_port=40999"], []):
        code, _, err = call(side, SILICONE, *port, *named, "--out", "out")
        assert code == 2
        assert said in " ".join(err.split())


def test_an_example_almost_named_is_meant_and_others_are_listed_by_kind(call):
    code, _, err = call("check", "silicone_cub")
    assert (code, err.endswith("did you mean 'silicone_cube'?\n")) == (2, True)
    code, _, err = call("check", "zzz")
    assert code == 2
    assert "; shipped trials: " in err
    assert "; shipped rigs: " in err


def test_matplotlib_does_not_report_its_font_cache(call, caplog):
    assert call("--version")[0] == 0
    logging.getLogger("matplotlib.font_manager").warning("Matplotlib is building the font cache")
    assert not caplog.records


@pytest.mark.parametrize("phase", ["make_context", "invoke"])
def test_an_interrupt_before_a_command_handles_it_ends_with_one_line(call, monkeypatch, phase):
    def interrupted(*_arguments, **_more):
        raise KeyboardInterrupt

    monkeypatch.setattr(TyperGroup, phase, interrupted)
    assert call("check", SILICONE) == (130, "", "interrupted\n")
