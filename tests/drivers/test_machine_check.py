"""Findings of `doctor` on scheduling: privileges of the loop, stalls by the rig's bounds."""

import gc
import os
import subprocess
import sys

import numba
import pytest
from framed_bench import load

from teleop_rt.config.realtime import LateConfig
from teleop_rt.realtime.lateness import Lateness
from teleop_rt.realtime.scheduling import Privilege
from teleop_rt_drivers.machine_check import (
    examine_machine,
    judged_privilege,
    judged_stalls,
    judged_wake_up,
)

MS = 1_000_000
HARDWARE, SIMULATED = LateConfig(), LateConfig(hold_ms=5, stop_ms=50, stop_share=1)


@pytest.mark.parametrize(
    ("bounds", "stall_ms", "severity"),
    [(HARDWARE, 4, "ok"), (HARDWARE, 8, "warning"), (HARDWARE, 30, "error"),
     (SIMULATED, 30, "warning"), (SIMULATED, 55, "error")],
)  # fmt: skip
def test_a_stall_is_judged_by_the_rigs_bounds_and_reported_with_them(bounds, stall_ms, severity):
    late = Lateness(bounds, MS)
    for late_ns in (0, stall_ms * MS, 0):
        late.update(late_ns)
    found = judged_stalls(late, 2.0)
    assert found.severity == severity
    assert f"{stall_ms:.1f} ms" in found.what
    assert f"stops from {bounds.stop_ms:g} ms on" in found.what
    assert bool(found.next_step) == (severity != "ok")


def test_a_refused_privilege_is_a_warning_with_what_grants_it():
    asked = Privilege("SCHED_FIFO", granted=False, reason="no", how_to_grant="setcap it")
    found = judged_privilege(asked)
    assert (found.severity, found.next_step) == ("warning", "setcap it")
    assert found.where == "scheduling, SCHED_FIFO"


@pytest.mark.parametrize(("late_us", "severity"), [(50.0, "ok"), (900.0, "warning")])
def test_a_loop_that_wakes_late_is_reported(late_us, severity):
    assert judged_wake_up([late_us] * 100).severity == severity


FIRST_TICK = """
from types import SimpleNamespace
from teleop_rt.realtime.lateness import ON_HARDWARE, judge_lateness
from teleop_rt_drivers import machine_check

class Clock:
    wake_latency_ns = 0
    def __init__(self, *_): pass
    def wait_next_tick(self):
        print(len(judge_lateness.signatures))
        return 0

machine_check.RealClock = Clock
rig = SimpleNamespace(
    period_ns=1_000_000, rate_hz=1000, realtime=SimpleNamespace(spin_us=0, late=ON_HARDWARE)
)
machine_check.run_bare_loop(rig, 0.002, lambda: None)
"""


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled")
def test_what_judges_the_bare_loop_is_compiled_before_its_first_tick():
    """It was loaded in it: a stall of 95 ms, and an error, on a machine without any."""
    argv = [sys.executable, "-c", FIRST_TICK]
    assert subprocess.run(argv, capture_output=True, text=True, check=True).stdout == "1\n1\n"


def test_the_machine_is_asked_as_the_loop_asks_and_gets_everything_back():
    before = os.sched_getscheduler(0), os.sched_getaffinity(0), gc.isenabled()
    findings = examine_machine(load("canopen"), seconds=0.02)
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0), gc.isenabled()) == before
    result = {found.where: found for found in findings}
    assert {"scheduling, SCHED_FIFO", "scheduling, mlockall", "scheduling, cores",
            "scheduling, timer", "scheduling, stalls", "clock"} <= set(result)  # fmt: skip
