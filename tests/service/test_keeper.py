"""Helpers beside the loop: restarted after an unexpected end, and reported."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from teleop_rt.realtime.leftovers import began
from teleop_rt.realtime.ring_folder import RING_ROWS
from teleop_rt.realtime.state_file import leave
from teleop_rt.service.keeper import PAUSES_S, Restarts, watched
from teleop_rt.service.status import unwatched

HIGHEST_RATE_HZ = 4000

HELPER = """
import json, os, signal, sys
def emit(event, **content):
    os.write(1, json.dumps({"event": event, **content}).encode() + b"\\n")
def main(arguments):
    folder, how = arguments
    run = len(os.listdir(folder))
    def end(*_):
        emit("done", run=run)
        sys.exit(0)
    signal.signal(signal.SIGTERM, end)
    open(f"{folder}/{os.getpid()}", "w").close()
    if how == "bad":
        emit("problem", message="no such thing")
        sys.exit(2)
    emit("ready")
    if how == "once" and run == 0:
        raise RuntimeError("on purpose")
    while True:
        signal.pause()
"""


class Kept:
    """A keeper with its helper, which leaves a file for each of its runs."""

    def __init__(self, folder, how):
        self.ring_folder, self.runs = folder / "rings", folder / "runs"
        self.ring_folder.mkdir()
        self.runs.mkdir()
        (folder / "helper.py").write_text(HELPER)
        words = ["recorder", self.ring_folder, "helper", self.runs, how]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "teleop_rt.service.keeper", *map(str, words)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), *sys.path])},
        )

    def event(self) -> dict:
        assert self.process.stdout is not None
        return json.loads(self.process.stdout.readline())

    def helpers(self, count: int) -> list[int]:
        """Wait for so many runs of the helper; return their process ids, oldest first."""
        while len(list(self.runs.iterdir())) < count:
            time.sleep(0.005)
        files = sorted(self.runs.iterdir(), key=lambda path: path.stat().st_mtime_ns)
        return [int(path.name) for path in files]

    def restarts(self, count: int) -> dict:
        path = self.ring_folder / "recorder.keeper"
        while not path.exists() or json.loads(path.read_text())["restarts"] < count:
            time.sleep(0.005)
        state = json.loads(path.read_text())
        assert state.pop("keeper")["pid"] == self.process.pid
        del state["helper"]
        return state

    def end(self) -> tuple[list[dict], list[dict]]:
        self.process.terminate()
        out, errors = self.process.communicate()
        lines = [line for line in errors.splitlines() if line.startswith("{")]
        return [json.loads(line) for line in out.splitlines()], [json.loads(one) for one in lines]


@pytest.fixture
def kept(tmp_path):
    started = []

    def start(how) -> Kept:
        started.append(Kept(tmp_path, how))
        return started[0]

    yield start
    for one in started:
        one.process.kill()
        one.process.communicate()


def test_a_helper_that_is_killed_is_started_again_and_its_end_is_counted_and_reported(kept):
    one = kept("well")
    assert one.event() == {"event": "ready"}
    for count in (1, 2):
        os.kill(one.helpers(count)[-1], signal.SIGKILL)
        result = {"name": "recorder", "restarts": count, "last_end": "killed by signal 9"}
        assert one.restarts(count) == result
    one.helpers(3)
    (done,), log = one.end()
    assert done == {"event": "done", "run": 2, "restarts": 2}
    assert one.process.returncode == 0
    assert [(line["event"], line["restarts"], line["pause_s"]) for line in log] == [
        ("restart", 1, 0.0),
        ("restart", 2, 0.1),
    ]


def test_a_helper_that_never_was_ready_is_not_started_again_but_reported(kept):
    one = kept("bad")
    assert one.event() == {"event": "problem", "message": "no such thing"}
    assert one.process.wait() == 2
    assert len(one.helpers(1)) == 1


def test_a_helper_that_is_down_when_all_ends_runs_once_more_to_finish(kept):
    one = kept("once")
    assert one.event() == {"event": "ready"}
    os.kill(one.helpers(2)[-1], signal.SIGKILL)  # the second end is followed by a pause
    assert one.restarts(2)["last_end"] == "killed by signal 9"
    (done,), log = one.end()
    assert done == {"event": "done", "run": 2, "restarts": 2}
    assert log[0]["last_end"] == "ended with exit code 1"


def killed(process: int) -> None:
    """Kill a process and wait for its end; it stays a zombie: the daemon waits for nobody."""
    os.kill(process, signal.SIGKILL)
    os.waitid(os.P_PID, process, os.WEXITED | os.WNOWAIT)


def test_a_keeper_that_is_killed_is_reported_and_whether_its_helper_goes_on(kept):
    one = kept("well")
    assert one.event() == {"event": "ready"}
    (helper,) = one.helpers(1)
    assert watched(one.ring_folder, "recorder")
    assert list(unwatched(one.ring_folder)) == []
    killed(one.process.pid)
    assert not watched(one.ring_folder, "recorder")
    (alarm,) = unwatched(one.ring_folder)
    assert "keeper of the recorder was killed: the daemon records on, but" in alarm
    os.kill(helper, signal.SIGKILL)
    while began(helper) is not None:  # it is another process's child now
        time.sleep(0.005)
    (alarm,) = unwatched(one.ring_folder)
    assert "keeper of the recorder was killed: the daemon records no more" in alarm


def test_a_keeper_that_the_kernel_did_not_let_name_itself_is_not_reported_as_killed(tmp_path):
    Restarts("commands", tmp_path)  # as by this process, which has another name
    assert watched(tmp_path, "commands")
    assert list(unwatched(tmp_path)) == []


def test_another_process_with_the_keepers_number_is_none(tmp_path):
    Restarts("commands", tmp_path)
    left = tmp_path / "commands.keeper"
    state = json.loads(left.read_text())
    state["keeper"]["began"] -= 1
    leave(left, state)
    assert not watched(tmp_path, "commands")


def test_pauses_grow_up_to_less_than_a_ring_holds_and_begin_again_after_a_calm_minute(
    tmp_path, capsys
):
    restarts = Restarts("recorder", tmp_path)
    pauses = [restarts.next_pause_s(-9, 1.0) for _ in range(len(PAUSES_S) + 3)]
    assert pauses == [*PAUSES_S, *[PAUSES_S[-1]] * 3]
    assert pauses == sorted(pauses)
    assert pauses[-1] < RING_ROWS / HIGHEST_RATE_HZ
    assert restarts.next_pause_s(1, 61.0) == 0.0
    assert restarts.next_pause_s(1, 1.0) == PAUSES_S[1]
    last = json.loads(capsys.readouterr().err.splitlines()[-1])
    assert (last["restarts"], last["last_end"]) == (len(PAUSES_S) + 5, "ended with exit code 1")
