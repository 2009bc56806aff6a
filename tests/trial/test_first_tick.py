"""A cycle loads no module and compiles nothing: that takes time in which nobody obeys."""

import ast
import subprocess
import sys

from lean_install import without_report

_SPY = """
import sys
from teleop_rt.__main__ import main
from teleop_rt.master.master import Master
from teleop_rt.realtime.lateness import judge_lateness
from teleop_rt.slave.slave import Slave

inside = False
loaded = []

def heard(event, arguments):
    if inside and event == "import":
        loaded.append(arguments[0])

def watched(cycle):
    def cycle_watched(*arguments, **named):
        global inside
        inside = True
        if not judge_lateness.signatures:
            loaded.append("judge_lateness, which the next look at the clock compiles")
        try:
            cycle(*arguments, **named)
        finally:
            inside = False
    return cycle_watched

sys.addaudithook(heard)
Master.cycle, Slave.cycle = watched(Master.cycle), watched(Slave.cycle)
try:
    main()
finally:
    print(loaded)
"""


def test_no_cycle_of_slave_or_master_loads_a_module(tmp_path):
    spied = [sys.executable, "-c", _SPY, "run", "handle", "--clock", "simulated"]
    run = subprocess.run(
        [*spied, "--set", "duration_s=1", "--out", "run"],
        cwd=tmp_path,
        env=without_report(tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    assert ast.literal_eval(run.stdout.splitlines()[-1]) == []
