"""Checks of this machine for a rig's loop: privileges requested, wake-up latency measured."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from teleop_rt.realtime.clock import RealClock
from teleop_rt.realtime.lateness import Lateness, late_ns, load_kernels
from teleop_rt.realtime.scheduling import prepare_process, remember_process
from teleop_rt_drivers.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from teleop_rt.config.rig import RigConfig
    from teleop_rt.realtime.scheduling import Privilege

LOOKED_S = 2.0
"""Time that a bare loop of the rig's rate is watched; rare stalls take longer to be met."""
LATE_US = 200.0
"""99th percentile of the wake latency above which a tick of 1 kHz has little room left."""
GOOD_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock")


def examine_machine(
    rig: RigConfig, seconds: float = LOOKED_S, between: Callable[[], None] = lambda: None
) -> list[Finding]:
    """Return the findings on the machine: privileges, cores, clock source, wake latency and stalls.

    `between` is called once a tick of the bare loop.
    """
    give_back = remember_process()
    try:
        machine = rig.realtime
        asked = prepare_process(machine.priority, machine.cpu, awake=machine.awake)
        latencies_us, late = run_bare_loop(rig, seconds, between)
    finally:
        give_back()
    findings = [judged_privilege(privilege) for privilege in asked]
    if machine.cpu is None:
        findings.append(_cores())
    return [*findings, _clock_source(), judged_wake_up(latencies_us), judged_stalls(late, seconds)]


def run_bare_loop(
    rig: RigConfig, seconds: float, between: Callable[[], None]
) -> tuple[list[float], Lateness]:
    """Run the loop's clock without any work; return wake latencies [us] and its lateness."""
    load_kernels()  # in the first tick it would be a stall of 100 ms
    clock = RealClock(rig.period_ns, round(rig.realtime.spin_us * 1e3))
    late = Lateness(rig.realtime.late, rig.period_ns)
    latencies_us = []
    ticks = round(seconds * rig.rate_hz)
    while ticks > 0:
        skipped = clock.wait_next_tick()
        late.update(late_ns(skipped, clock.wake_latency_ns, rig.period_ns))
        latencies_us.append(clock.wake_latency_ns * 1e-3)
        ticks -= 1 + skipped
        between()
    return latencies_us, late


def judged_privilege(privilege: Privilege) -> Finding:
    """Return a privilege as the loop asked for it: a refusal is a warning."""
    where = f"scheduling, {privilege.name}"
    if privilege.granted:
        return Finding("ok", f"granted ({privilege.reason})", where)
    return Finding("warning", f"refused ({privilege.reason})", where, privilege.how_to_grant)


def judged_wake_up(latencies_us: Iterable[float]) -> Finding:
    """Judge how late a bare loop woke up."""
    p50, p99 = np.percentile(list(latencies_us), (50, 99))
    what = f"a bare loop wakes {p50:.0f} us late (p50), {p99:.0f} us (p99)"
    if p99 > LATE_US:
        step = "isolate a core, end programs that load the machine, or use a PREEMPT_RT kernel"
        return Finding("warning", what, "scheduling, timer", step)
    return Finding("ok", what, "scheduling, timer")


def judged_stalls(late: Lateness, seconds: float) -> Finding:
    """Judge the stalls of a bare loop by the rig's own bounds."""
    stalls, where = late.outcome(), "scheduling, stalls"
    bounds = stalls["bounds"]
    what = (
        f"the longest stall in {seconds:g} s was {stalls['longest_stall_ms']:.1f} ms; "
        f"realtime.late holds from {bounds['hold_ms']:g} ms on and "
        f"stops from {bounds['stop_ms']:g} ms on"
    )
    step = "isolate a core (isolcpus) and name it in realtime.cpu, or end other programs"
    if stalls["stop"] is not None:
        return Finding("error", what, where, step)
    return Finding("warning", what, where, step) if stalls["holds"] else Finding("ok", what, where)


def _cores() -> Finding:
    cores = sorted(os.sched_getaffinity(0))
    what = f"the loop runs on any of the cores {cores}: realtime.cpu is not set"
    if len(cores) == 1:
        step = "give the machine a second core: everything else runs on the loop's"
        return Finding("warning", what, "scheduling, cores", step)
    return Finding("ok", what, "scheduling, cores")


def _clock_source() -> Finding:
    path = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    name = path.read_text().strip() if path.is_file() else "unknown"
    if name in GOOD_CLOCKS:
        return Finding("ok", f"clock source {name}", "clock")
    step = "boot with `clocksource=tsc` if the machine's is stable"
    return Finding("warning", f"clock source {name}: reading time is slow", "clock", step)
