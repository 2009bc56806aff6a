"""A process that is tied to another ends with it, also where the kernel does not say so."""

import os
import select
import subprocess
import sys

import pytest

PATIENCE_S = 30
CHILD = """
from teleop_rt.realtime import parent
if {refused}:
    parent._signalled_by_kernel = lambda: False
parent.end_with_parent()
print("ready", flush=True)
signal.pause()
"""
PARENT = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"


@pytest.mark.parametrize("refused", [False, True])
def test_a_process_ends_with_a_parent_that_is_killed(refused):
    with subprocess.Popen(
        [sys.executable, "-c", PARENT, CHILD.format(refused=refused)], stdout=subprocess.PIPE
    ) as parent:
        assert parent.stdout is not None
        output = parent.stdout.fileno()
        assert parent.stdout.readline() == b"ready\n"
        parent.kill()
        ended, _, _ = select.select([output], [], [], PATIENCE_S)
        assert ended, "the child goes on, and holds the pipe"
        assert os.read(output, 100) == b""


def test_a_process_that_looks_for_its_parent_ends_in_good_order():
    often = CHILD.replace("if {refused}", "parent._LOOK_EVERY_S = 1e-4\nif {refused}")
    ending = often.format(refused=True).replace("signal.pause()", "")
    done = subprocess.run([sys.executable, "-c", ending], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
