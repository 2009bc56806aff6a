"""Findings of `doctor` on scheduling: privileges of the loop, stalls by the rig's bounds."""

import gc
import os

import pytest
from framed_bench import load

from teleop_rt.config_realtime import LateConfig
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
    assert f"stops from {bounds.stop_ms:g}" in found.what
    assert bool(found.next_step) == (severity != "ok")


def test_a_refused_privilege_is_a_warning_with_what_grants_it():
    asked = Privilege("SCHED_FIFO", granted=False, reason="no", how_to_grant="setcap it")
    found = judged_privilege(asked)
    assert (found.severity, found.next_step) == ("warning", "setcap it")
    assert found.where == "scheduling, SCHED_FIFO"


@pytest.mark.parametrize(("late_us", "severity"), [(50.0, "ok"), (900.0, "warning")])
def test_a_loop_that_wakes_late_is_reported(late_us, severity):
    assert judged_wake_up([late_us] * 100).severity == severity


def test_the_machine_is_asked_as_the_loop_asks_and_gets_everything_back():
    before = os.sched_getscheduler(0), os.sched_getaffinity(0), gc.isenabled()
    findings = examine_machine(load("canopen"), seconds=0.02)
    assert (os.sched_getscheduler(0), os.sched_getaffinity(0), gc.isenabled()) == before
    result = {found.where: found for found in findings}
    assert {"scheduling, SCHED_FIFO", "scheduling, mlockall", "scheduling, cores",
            "scheduling, timer", "scheduling, stalls", "clock"} <= set(result)  # fmt: skip
