"""Sides of a run are forks of it: their output, their end, and the state they take over."""

import mmap
import os
import resource
import signal
import subprocess
import sys

import pytest

from teleop_rt.errors import ExpectedError
from teleop_rt.interrupts import Interrupts
from teleop_rt.realtime.parent import emit_to_parent
from teleop_rt.realtime.scheduling import prepare_process
from teleop_rt.realtime.state_file import found
from teleop_rt.service.keeper import kept
from teleop_rt.trial.processes import Gate, ProcessFailedError, TrialProcesses
from teleop_rt_dev.trial.files import SILICONE


@pytest.fixture
def processes(tmp_path):
    made = TrialProcesses(tmp_path / "log", "leader")
    yield made
    made.close()


def test_a_fork_reports_its_events_and_finds_loaded_what_the_run_has_loaded(processes):
    loaded = set(sys.modules)

    def main():
        imported = set(sys.modules) - loaded
        emit_to_parent(
            "ready", imported=sorted(name for name in imported if "multiprocessing" not in name)
        )
        signal.pause()

    child = processes.start("master", main)
    processes.wait_ready(child)
    assert child.events["ready"]["imported"] == []
    processes.end(["master"])
    assert child.process.poll() == -signal.SIGTERM


def test_a_fork_that_prepares_itself_writes_what_it_took_over_without_page_faults(processes):
    pages = mmap.mmap(-1, 4096 * mmap.PAGESIZE, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS)
    pages.madvise(mmap.MADV_NOHUGEPAGE)
    places = range(0, len(pages), mmap.PAGESIZE)

    def write():
        for place in places:
            pages[place] = 1

    def main():
        prepare_process(1)
        before = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
        write()
        after = resource.getrusage(resource.RUSAGE_THREAD).ru_minflt
        emit_to_parent("ready", faults=after - before)
        signal.pause()

    write()
    child = processes.start("slave", main)
    processes.wait_ready(child)
    assert child.events["ready"]["faults"] < 40
    processes.end(["slave"])


def test_a_fork_obeys_a_signal_also_where_the_run_turns_signals_into_interrupts(processes):
    with Interrupts() as interrupts:
        interrupts.hold()
        child = processes.start("master", signal.pause)
        processes.end(["master"])
    assert child.process.wait() == -signal.SIGTERM


def test_an_expected_error_in_a_fork_goes_to_the_log_with_its_exit_code(processes, tmp_path):
    class RefusedError(ExpectedError):
        code = 2

    def main():
        raise RefusedError("rig.yaml: no such rig")

    child = processes.start("sim", main)
    with pytest.raises(ProcessFailedError, match="sim: ended with exit code 2") as failed:
        processes.wait_ready(child)
    assert failed.value.code == 2
    assert (tmp_path / "log").read_text() == "rig.yaml: no such rig\n"
    assert child.process.wait() == 2


def test_a_fork_that_obeys_no_signal_is_killed(processes, monkeypatch):
    monkeypatch.setattr("teleop_rt.trial.processes.END_TIMEOUT_S", 0.2)

    def main():
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        emit_to_parent("ready")
        while True:
            signal.pause()

    child = processes.start("master", main)
    processes.wait_ready(child)
    processes.end(["master"])
    assert child.process.poll() == -signal.SIGKILL


def test_a_fork_goes_on_when_its_gate_opens_and_not_before(processes, tmp_path):
    gate, passed = Gate(), tmp_path / "passed"

    def main():
        gate.wait()
        passed.touch()
        emit_to_parent("ready")
        signal.pause()

    child = processes.start("slave", main)
    processes.watch(0.0)
    assert child.process.poll() is None
    assert not passed.exists()
    gate.open()
    processes.wait_ready(child)
    assert passed.exists()
    gate.close()


def test_a_fork_leaves_where_its_gate_is_closed_without_having_opened(processes):
    gate = Gate()
    child = processes.start("slave", gate.wait)
    gate.close()
    assert child.process.wait(10.0) == 1


def test_a_forked_helper_is_kept_going_and_finishes_at_the_end(processes, tmp_path):
    def main(arguments):
        signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGTERM])
        emit_to_parent("ready", arguments=list(arguments))
        signal.sigwait([signal.SIGTERM])
        emit_to_parent("done", finished=True)

    def after_restarts(count):
        return kept(tmp_path, "recorder")["restarts"] == count and helper() is not None

    def helper():
        return (found(tmp_path / "recorder.keeper") or {})["helper"]

    child = processes.fork_kept("recorder", tmp_path, main, ["one"])
    processes.wait_ready(child)
    assert child.events["ready"]["arguments"] == ["one"]
    first = helper()["pid"]
    os.kill(first, signal.SIGKILL)
    processes.run_until(lambda: after_restarts(1) and helper()["pid"] != first)
    processes.end(["recorder"])
    assert child.events["done"]["finished"]
    assert child.process.poll() == 0


LOADS_KERNELS = """
import os, sys
from pathlib import Path
from teleop_rt.cli import whole_run
from teleop_rt.trial.estimators import make_pipeline
from teleop_rt.trial.run_processes import prepared_to_fork
trial = whole_run.load_trial_file(Path(sys.argv[1]), [])
with prepared_to_fork():
    loaded = set(sys.modules)
    for cached in (False, True):  # where no cache holds the kernels yet, the first compiles them
        if child := os.fork():
            os.waitpid(child, 0)
            continue
        make_pipeline(trial)
        if cached:
            print(sorted(set(sys.modules) - loaded), flush=True)
        os._exit(0)
"""


def test_a_side_that_is_forked_loads_its_kernels_without_any_module_of_the_compiler():
    """Four processes that each load it occupy a small machine for most of the start."""
    words = [sys.executable, "-c", LOADS_KERNELS, str(SILICONE)]
    assert subprocess.check_output(words, text=True) == "[]\n"
