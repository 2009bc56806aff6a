"""Processes forked for independent calls: results, lost workers, orphans, listeners."""

import os
import select
import signal
import subprocess
import sys
from contextlib import suppress
from functools import partial
from operator import call

import pytest

from teleop_rt.batch.forked import WorkerLostError, as_finished
from teleop_rt.diagnosis.phases import enter, heard_by


def test_results_carry_the_index_of_their_item_and_come_from_other_processes():
    found = dict(as_finished(call, [partial(pow, 2, n) for n in range(7)], 3))
    assert found == {n: 2**n for n in range(7)}
    pids = set(dict(as_finished(call, [os.getpid] * 4, 2)).values())
    assert os.getpid() not in pids


def test_one_process_is_this_one():
    assert dict(as_finished(call, [os.getpid], 8)) == {0: os.getpid()}
    assert dict(as_finished(call, [os.getpid] * 2, 1)) == {0: os.getpid(), 1: os.getpid()}
    assert list(as_finished(call, [], 8)) == []


def kill_itself() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_that_dies_is_reported_with_what_to_do():
    with pytest.raises(WorkerLostError, match="try fewer with --jobs"):
        list(as_finished(call, [kill_itself] * 3, 2))


def fail() -> None:
    raise ValueError("no such thing")


def test_an_exception_of_a_call_is_raised_here_and_ends_the_others():
    with pytest.raises(ValueError, match="no such thing"):
        list(as_finished(call, [fail] * 20, 2))


def test_a_forked_call_does_not_reach_the_listener_of_its_parent():
    heard: list[str] = []
    read_end, write_end = os.pipe()
    os.set_blocking(read_end, False)
    listener = partial(os.write, write_end)
    with heard_by(lambda phase: (heard.append(phase), listener(phase.encode()))[0]):
        list(as_finished(enter, ["fit", "search"], 2))
        with pytest.raises(BlockingIOError):
            os.read(read_end, 1)
        list(as_finished(enter, ["fit", "search"], 1))
    assert heard == ["fit", "search"]
    assert os.read(read_end, 100) == b"fitsearch"
    os.close(read_end)
    os.close(write_end)


WAITS = """
import os, signal, sys
from operator import call
from teleop_rt.batch.forked import as_finished

def wait():
    os.write(1, f"{os.getpid()}\\n".encode())
    signal.pause()

list(as_finished(call, [wait, wait], 2))
"""


def test_workers_end_with_a_parent_that_is_killed():
    parent = subprocess.Popen([sys.executable, "-c", WAITS], stdout=subprocess.PIPE)
    assert parent.stdout is not None
    ends = [os.pidfd_open(int(parent.stdout.readline())) for _ in range(2)]
    parent.kill()
    parent.wait()
    waiting = select.poll()
    for end in ends:
        waiting.register(end, select.POLLIN)
        assert waiting.poll(30_000), "a worker outlives its parent"
        waiting.unregister(end)
        os.close(end)
    parent.stdout.close()


INTERRUPTED = """
import os, signal, sys
from operator import call
from teleop_rt.batch.forked import as_finished

signal.signal(signal.SIGINT, signal.default_int_handler)  # a job in the background ignores it

def wait():
    os.write(1, b"waits\\n")
    signal.pause()

try:
    list(as_finished(call, [wait] * 5, 2))
except KeyboardInterrupt:
    print("interrupted")
"""


IN_A_LOCK = """
import signal
from concurrent.futures import _base

class Interrupted(_base._AcquireFutures):
    def __enter__(self):
        super().__enter__()
        signal.raise_signal(signal.SIGINT)

_base._AcquireFutures = Interrupted
"""


@pytest.mark.parametrize("begin", ["", IN_A_LOCK], ids=["while it waits", "while it holds a lock"])
def test_an_interrupt_ends_the_workers_at_once(begin):
    work = subprocess.Popen(
        [sys.executable, "-c", begin + INTERRUPTED], stdout=subprocess.PIPE, start_new_session=True
    )
    assert work.stdout is not None
    try:
        if not begin:
            assert [work.stdout.readline() for _ in range(2)] == [b"waits\n"] * 2
            os.killpg(work.pid, signal.SIGINT)  # as a terminal sends it
        lines = work.communicate(timeout=30)[0].splitlines()
    finally:
        with suppress(ProcessLookupError):
            os.killpg(work.pid, signal.SIGKILL)
        work.communicate()
    assert lines[-1] == b"interrupted"
