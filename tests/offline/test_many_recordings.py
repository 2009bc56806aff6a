"""Many recordings: folders and globs, cores and clusters, bad files, and interrupts."""

import io
import json
import os
import re
import signal
import subprocess
import sys

import numpy as np
import pytest
from lean_install import without_pages
from schema_checks import violations

from teleop_rt.batch.sweep import CASES
from teleop_rt.cli.schema import SchemaName
from teleop_rt.contact.effects import find as effect
from teleop_rt.offline import closing_files, work
from teleop_rt.offline.find import find, names_one, own_names
from teleop_rt.offline.many import ANSWERS

RATE_HZ = 250.0
CHOSEN = ("--models", "kelvin-voigt,hunt-crossley", "--solvers", "rls")


def write_press(path, stiffness, seed=1, duration_s=3.0):
    """A spring and a damper pressed from free air, surface at 0."""
    t = np.arange(0.0, duration_s, 1.0 / RATE_HZ)
    x = 0.004 - 0.008 * np.cos(2.0 * np.pi * 1.5 * t)
    force = np.where(x > 0.0, stiffness * x + 8.0 * np.gradient(x, t), 0.0)
    force += np.random.default_rng(seed).normal(0.0, 0.02, t.size)
    path.parent.mkdir(parents=True, exist_ok=True)
    table = np.column_stack([t, x, force])
    np.savetxt(path, table, delimiter=",", header="t_s,position_m,force_N", comments="")


@pytest.fixture
def folder(tmp_path):
    """Four recordings in folders below each other, one of them bad, beside other files."""
    for number, name in enumerate(("a.csv", "deeper/b.csv", "deeper/c.csv")):
        write_press(tmp_path / "presses" / name, 1000.0 + 500.0 * number)
    (tmp_path / "presses" / "bad.csv").write_text("t_s,position_m,force_N\n0,0,0\n")
    (tmp_path / "presses" / "notes.txt").write_text("of the day")
    (tmp_path / "presses" / ".hidden").mkdir()
    (tmp_path / "presses" / ".hidden" / "d.csv").write_text("t_s\n")
    return tmp_path / "presses"


@pytest.fixture
def two_effects(monkeypatch):
    """Diagnose with two effects and without pages: the command, not the answer, is tested here."""
    known = (effect("coulomb_friction"), effect("force_bias"))
    for module in (work, closing_files):
        monkeypatch.setattr(module, "library", lambda _own: known)
    with without_pages():
        yield


def relative(paths, folder):
    return [path.relative_to(folder).as_posix() for path in paths]


def test_a_folder_stands_for_all_recordings_below_it_each_once(folder):
    every = ["a.csv", "bad.csv", "deeper/b.csv", "deeper/c.csv"]
    assert relative(find([folder]), folder) == every
    assert relative(find([folder / "deeper" / "c.csv", folder]), folder) == [
        "deeper/c.csv", "a.csv", "bad.csv", "deeper/b.csv",
    ]  # fmt: skip
    assert relative(find([folder / "**" / "[bc].csv"]), folder) == every[2:]
    (folder / "deeper" / "run").mkdir()
    (folder / "deeper" / "run" / "recording.mcap").touch()
    (folder / "deeper" / "run" / "motion.csv").touch()
    (folder / "x.part0002.mcap").touch()
    (folder / "x.part0003.mcap").touch()
    assert relative(find([folder]), folder) == [*every, "deeper/run", "x.mcap"]


def test_one_recording_is_one_only_where_it_is_named_itself(folder):
    assert names_one([folder / "a.csv"])
    assert not names_one([folder / "*a.csv"])
    assert not names_one([folder])
    assert not names_one([folder / "a.csv", folder / "deeper" / "b.csv"])


def test_no_name_of_what_is_written_is_given_twice(tmp_path):
    paths = [tmp_path / name for name in ("a-2.csv", "one/a.csv", "two/a.csv", "a.npz")]
    names = own_names(paths)
    assert len(set(names.values())) == len(paths)


def test_many_give_the_very_bytes_that_each_alone_gives(call, folder, tmp_path):
    alone = [call("replay", path, *CHOSEN, "--json") for path in find([folder])]
    expected = "".join(out for _, out, _ in alone)
    for jobs in (1, 2):
        code, out, err = call("replay", folder, *CHOSEN, "--json", "--jobs", jobs)
        assert (code, out) == (2, expected)
        assert err.splitlines()[-1] == f"1 of 4 recordings have no answer: {folder}/bad.csv"
    assert [code for code, _, _ in alone] == [0, 2, 0, 0]
    printed = [call("replay", path, *CHOSEN)[1] for path in find([folder])]
    assert call("replay", folder / "*.csv", folder / "deeper", *CHOSEN)[1] == "".join(printed)


@pytest.mark.usefixtures("two_effects")
def test_diagnoses_on_two_cores_are_those_of_each_alone(call, folder, tmp_path):
    for name in ("b.csv", "c.csv"):
        (folder / "deeper" / name).unlink()
    write_press(folder / "a.csv", 1500.0, duration_s=1.6)
    result = ("--base", "kelvin-voigt", "--surface", "0", "--json")
    alone = "".join(call("diagnose", path, *result)[1] for path in find([folder]))
    code, out, _ = call("diagnose", folder, *result, "--jobs", 2, "--out", "found")
    assert (code, out) == (2, alone)
    answers = [json.loads(line) for line in out.splitlines()]
    assert ["verdict" in answer for answer in answers] == [True, False]
    assert [violations(SchemaName.ANSWER, answer) for answer in answers] == [[], []]
    for answer in answers:
        assert violations(SchemaName.ANSWER, answer | {"key_of_a_later_version": 1})
        for key in answer:
            less = {name: value for name, value in answer.items() if name != key}
            assert violations(SchemaName.ANSWER, less), key
    assert (tmp_path / "found" / ANSWERS).read_text() == alone
    assert {path.name for path in (tmp_path / "found").iterdir() if path.is_dir()} == {"a"}


class Terminal(io.StringIO):
    """Standard error of somebody who watches."""

    def isatty(self):
        return True


def seen(terminal):
    """The words on a terminal, without the codes of its cursor."""
    return re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", terminal.getvalue())


PHASES = (
    *("reading a.csv", "finding surface and motion", "fitting the base", "trying single effects"),
    "error on held-out data",
)


@pytest.mark.usefixtures("two_effects")
def test_a_terminal_shows_each_phase_of_a_diagnosis_and_json_stays_alone(call, folder, monkeypatch):
    write_press(folder / "a.csv", 1500.0, duration_s=1.6)
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    code, out, _ = call("diagnose", folder / "a.csv", "--surface", "0", "--json")
    assert code == 0
    assert json.loads(out)["verdict"] == "no_missing_effect"
    shown = [seen(terminal).find(phase) for phase in ("loading the effects", *PHASES)]
    assert -1 not in shown
    assert shown == sorted(shown)


@pytest.mark.usefixtures("two_effects")
def test_without_a_terminal_each_phase_is_one_line_on_standard_error(call, folder):
    write_press(folder / "a.csv", 1500.0, duration_s=1.6)
    code, out, err = call("diagnose", folder / "a.csv", "--surface", "0", "--json")
    assert code == 0
    assert json.loads(out)["verdict"] == "no_missing_effect"
    lines = err.splitlines()
    assert [line for line in lines if line.removesuffix(" ...") in PHASES] == [
        f"{phase} ..." for phase in PHASES
    ]
    assert all(line.endswith(" ...") for line in lines)


def test_a_terminal_shows_how_many_are_done_and_answers_go_to_standard_output(
    call, folder, monkeypatch
):
    alone = call("replay", folder, *CHOSEN, "--json")[1]
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    assert call("replay", folder, *CHOSEN, "--json", "--jobs", 1)[1] == alone
    assert "4/4" in seen(terminal)
    assert "1 of 4 recordings have no answer" in seen(terminal)


def done(folder):
    """The recordings whose answers a folder keeps, in the order in which they were computed."""
    lines = (folder / CASES).read_text().splitlines()
    return [json.loads(line)["case"]["name"] for line in lines]


def test_what_was_answered_is_not_computed_again_unless_it_changed(call, folder, tmp_path):
    arguments = ("replay", folder, *CHOSEN, "--json", "--jobs", 1, "--out", "out")
    first = call(*arguments)
    assert done(tmp_path / "out") == ["a", "b", "c"]
    assert call(*arguments) == first
    assert done(tmp_path / "out") == ["a", "b", "c"]
    write_press(folder / "deeper" / "b.csv", 9000.0)
    write_press(folder / "bad.csv", 700.0)
    code, out, err = call(*arguments)
    assert (code, err) == (0, "")
    assert done(tmp_path / "out") == ["a", "b", "c", "bad", "b"]
    assert out == (tmp_path / "out" / ANSWERS).read_text() != first[1]
    kept = (tmp_path / "out" / ANSWERS).read_bytes()
    for other in (("replay", folder, "--models", "kelvin-voigt"), ("diagnose", folder)):
        code, _, err = call(*other, "--json", "--out", "out", "--jobs", 1)
        assert code == 2
        assert "out: holds something other than" in err
        assert "with these options: name another folder with --out" in err
    assert (tmp_path / "out" / ANSWERS).read_bytes() == kept


def test_a_trace_that_was_removed_is_written_again(call, folder, tmp_path):
    arguments = ("replay", folder, *CHOSEN, "--jobs", 1, "--out", "out", "--trace", "theta.npz")
    call(*arguments)
    assert {path.name for path in tmp_path.glob("*.npz")} == {f"theta-{n}.npz" for n in "abc"}
    (tmp_path / "theta-b.npz").unlink()
    call(*arguments)
    assert (tmp_path / "theta-b.npz").is_file()
    assert done(tmp_path / "out") == ["a", "b", "c", "b"]


def test_a_killed_command_goes_on_where_it_stopped(call, folder, tmp_path):
    for number in range(20):
        write_press(folder / f"more-{number:02}.csv", 1500.0, seed=number)
    arguments = ["replay", str(folder), *CHOSEN, "--json", "--out", "out"]
    killed = subprocess.Popen(
        [sys.executable, "-m", "teleop_rt", *arguments, "--jobs", "1"],
        cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
    )  # fmt: skip
    for _ in range(3):
        assert killed.stdout.readline()
    os.kill(killed.pid, signal.SIGKILL)
    killed.communicate()
    kept = (tmp_path / "out" / CASES).read_bytes()
    assert 2 <= len(kept.splitlines()) < 23
    code, out, _ = call(*arguments)
    assert code == 2
    assert (tmp_path / "out" / CASES).read_bytes().startswith(kept)
    assert len(done(tmp_path / "out")) == 23
    assert out == call("replay", folder, *CHOSEN, "--json")[1]


def test_each_problem_names_its_file_as_it_was_given(call, folder):
    short = folder / "deeper" / "short.csv"
    short.write_text("t_s,position [m],force [N]\n0,0,0\n0.001,0,1\n")
    code, out, _ = call("replay", folder, *CHOSEN, "--json", "--jobs", 1)
    problems = [json.loads(line).get("problem") for line in out.splitlines()]
    assert code == 2
    assert [one for one in problems if one and "too short" in one] == [
        f"{short}: too short: 2 samples, at least 300 are needed"
    ]


def test_an_error_nobody_expected_ends_no_other_recording(call, folder, monkeypatch):
    plain = work.replay

    def breaks(path, choice, table, effects, *, traces):
        if path.name == "b.csv":
            raise ZeroDivisionError("by nothing")
        return plain(path, choice, table, effects, traces=traces)

    monkeypatch.setattr(work, "replay", breaks)
    code, out, err = call("replay", folder, *CHOSEN, "--json", "--jobs", 1)
    assert code == 1
    problem = json.loads(out.splitlines()[2])["problem"]
    assert problem.startswith(f"{folder}/deeper/b.csv: unexpected ZeroDivisionError: by nothing")
    assert "2 of 4 recordings have no answer" in err
    assert "estimators" in json.loads(out.splitlines()[3])


def test_a_dask_cluster_of_two_workers_gives_the_very_bytes(call, folder):
    distributed = pytest.importorskip("distributed")
    alone = call("replay", folder, *CHOSEN, "--json")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, host="127.0.0.1", protocol="tcp://",
        dashboard_address=None,
    ) as cluster:  # fmt: skip
        address = cluster.scheduler_address
        assert call("replay", folder, *CHOSEN, "--json", "--scheduler", address) == alone


def test_a_scheduler_that_does_not_answer_is_named(call, folder, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("teleop_rt.batch.workers.CONNECT_S", 0.2)
    code, out, err = call("replay", folder, *CHOSEN, "--scheduler", "tcp://127.0.0.1:9")
    assert (code, out) == (2, "")
    assert "no Dask scheduler answers at tcp://127.0.0.1:9" in err


def test_an_interrupt_reports_what_is_kept_and_the_same_command_goes_on(
    call, folder, tmp_path, monkeypatch
):
    arguments = ("replay", folder, *CHOSEN, "--json", "--jobs", 1, "--out", "out")
    answer = work.Replaying.answer

    def interrupted_at_b(replaying, recording, name):
        if name == "b":
            raise KeyboardInterrupt
        return answer(replaying, recording, name)

    with monkeypatch.context() as patch:
        patch.setattr(work.Replaying, "answer", interrupted_at_b)
        code, out, err = call(*arguments)
    assert code == 130, (out, err)
    assert "interrupted after 2 of 4 recordings; out keeps the answers so far" in err
    assert done(tmp_path / "out") == ["a"]
    assert call(*arguments)[0] == 2, "one is bad"
    assert done(tmp_path / "out") == ["a", "b", "c"]


@pytest.mark.usefixtures("two_effects")
def test_a_line_of_a_diagnosis_or_a_closed_loop_keeps_to_no_width_in_a_pipe(call, tmp_path):
    for name, seed in (("first", 1), ("other", 2)):
        write_press(tmp_path / f"{name}.csv", 1500.0, seed, 2.0)
    files = ("--recording", tmp_path / "first.csv", "--test", tmp_path / "other.csv")
    out = tmp_path / ("a folder of a long name " * 4)
    code, text, _ = call("close-loop", *files, "--out", out)
    assert code == 0
    assert text.splitlines()[-1] == f"files in {out}"
