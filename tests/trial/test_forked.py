"""Sides of a run are forks of it: what they print, how they end, and what they take over."""

import signal
import sys

import pytest

from teleop_rt.errors import ExpectedError
from teleop_rt.realtime.loop import Interrupts
from teleop_rt.realtime.parent import emit_to_parent
from teleop_rt.trial.processes import ProcessFailedError, Supervisor


@pytest.fixture
def supervisor(tmp_path):
    made = Supervisor(tmp_path / "log", "leader")
    yield made
    made.close()


def test_a_fork_reports_its_events_and_finds_loaded_what_the_run_has_loaded(supervisor):
    loaded = set(sys.modules)

    def main():
        imported = set(sys.modules) - loaded
        emit_to_parent(
            "ready", imported=sorted(name for name in imported if "multiprocessing" not in name)
        )
        signal.pause()

    child = supervisor.start("master", main)
    supervisor.wait_ready(child)
    assert child.events["ready"]["imported"] == []
    supervisor.end(["master"])
    assert child.process.poll() == -signal.SIGTERM


def test_a_fork_obeys_a_signal_also_where_the_run_turns_signals_into_interrupts(supervisor):
    with Interrupts() as interrupts:
        interrupts.ignore()
        child = supervisor.start("master", signal.pause)
        supervisor.end(["master"])
    assert child.process.wait() == -signal.SIGTERM


def test_an_expected_error_in_a_fork_goes_to_the_log_with_its_exit_code(supervisor, tmp_path):
    class RefusedError(ExpectedError):
        code = 2

    def main():
        raise RefusedError("rig.yaml: no such rig")

    child = supervisor.start("sim", main)
    with pytest.raises(ProcessFailedError, match="sim: ended with exit code 2") as failed:
        supervisor.wait_ready(child)
    assert failed.value.code == 2
    assert (tmp_path / "log").read_text() == "rig.yaml: no such rig\n"
    assert child.process.wait() == 2


def test_a_fork_that_obeys_no_signal_is_killed(supervisor, monkeypatch):
    monkeypatch.setattr("teleop_rt.trial.processes._END_TIMEOUT_S", 0.2)

    def main():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        emit_to_parent("ready")
        while True:
            signal.pause()

    child = supervisor.start("master", main)
    supervisor.wait_ready(child)
    supervisor.end(["master"])
    assert child.process.poll() == -signal.SIGKILL
