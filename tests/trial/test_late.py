"""A run's lateness in words and figures, and the advice."""

import io

import numpy as np
import pytest
from rich.console import Console

from teleop_rt.config.realtime import LateConfig
from teleop_rt.realtime.lateness import ON_HARDWARE, Lateness
from teleop_rt.realtime.scheduling import Privilege
from teleop_rt.slave.faults import State
from teleop_rt.trial.late import advice, both, cause, on_hardware, privileges_text, recorded, stalls
from teleop_rt.trial.table import print_summary
from teleop_rt_dev.trial.files import silicone

MS = 1_000_000
LOCK = Privilege("mlockall", granted=False, reason="EPERM", how_to_grant="prlimit")
WIDE = LateConfig(hold_ms=5, stop_ms=50, stop_share=1)


def fifo(*, granted):
    return Privilege("SCHED_FIFO", granted, reason="why", how_to_grant="sudo setcap it")


def lived(*stalls_ms, bounds=WIDE):
    late, default = Lateness(bounds, MS), Lateness(ON_HARDWARE, MS)
    for stall_ms in stalls_ms:
        late.update(round(stall_ms * MS))
        if not default.stopped:
            default.update(round(stall_ms * MS))
    return both(late, default)


def test_priority_that_was_refused_is_what_would_help_with_how_to_get_it():
    result = advice([fifo(granted=False)], 1000, None, simulated=True)
    assert result == "get real-time priority: sudo setcap it; or run it with --clock simulated"
    assert "clock" not in advice([fifo(granted=False)], 1000, None, simulated=False)


@pytest.mark.parametrize(
    ("rate_hz", "cpu", "simulated", "helps", "followed"),
    [
        (1000, None, True, ["--clock simulated", "--set rig.rate_hz=250"], ["setcap", "cpu"]),
        (250, None, True, ["--clock simulated"], ["rate_hz", "setcap"]),
        (1000, None, False, ["--set rig.rate_hz=250", "realtime.cpu"], ["clock", "setcap"]),
        (1000, 1, False, ["--set rig.rate_hz=250"], ["clock", "cpu", "setcap"]),
        (250, 1, False, ["end other programs"], ["rate_hz", "clock", "cpu", "setcap"]),
    ],
)
def test_advice_that_is_followed_already_is_not_given(rate_hz, cpu, simulated, helps, followed):
    result = advice([fifo(granted=True)], rate_hz, cpu, simulated=simulated)
    assert all(words in result for words in helps)
    assert not any(words in result for words in followed)


def test_what_hardware_would_have_done_is_reported_by_the_same_lateness():
    assert on_hardware(lived(0, 3, 0)).startswith("would have run on (hold_ms 5, stop_ms 20")
    assert on_hardware(lived(0, 7, 0, 8)).startswith("would have held 2 times (")
    stopped = lived(*[0] * 976, 23, 0, 40)
    assert on_hardware(stopped).startswith("would have stopped after 1.0 s: 23.0 ms (")
    assert stalls(stopped) == "40.0 ms, held 2 times (from 5 ms on)"
    assert stopped["stop"] is None


def test_the_cause_names_bound_time_and_stall():
    assert cause(lived(0, 63.2)) == (
        "the loop stalled for 63.2 ms after 0.1 s under power; realtime.late.stop_ms is 50"
    )
    share = lived(*[2] * 200, bounds=LateConfig(stop_share=0.3))
    assert cause(share).startswith("30 % of a second's ticks were late after 0.")


def test_which_privileges_the_loop_had_is_one_line():
    said = [one.describe() for one in (fifo(granted=True), LOCK)]
    assert privileges_text(said) == (
        "SCHED_FIFO granted (why), mlockall refused (EPERM), any core (realtime.cpu is not set)"
    )
    pinned = "core 1 alone: granted (pinned)"
    assert privileges_text([*said, pinned]).endswith("core 1 alone granted (pinned)")


def test_a_recording_reports_what_the_loop_would_have():
    """The loop's own figures, and those from its rows, agree on any course."""
    rng = np.random.default_rng(5)
    late, default = Lateness(WIDE, MS), Lateness(ON_HARDWARE, MS)
    rows, tick, powered = [], 0, False
    for cycle in range(3000):
        stall_ms = float(rng.choice([0.0, 0.03, 2.4, 7.0, 12.5], p=[0.9, 0.05, 0.03, 0.01, 0.01]))
        skipped, latency_us = int(stall_ms), 1e3 * stall_ms
        tick += 1 + skipped
        if powered:
            late.update(round(stall_ms * MS))
            if not default.stopped:
                default.update(round(stall_ms * MS))
        before, powered = powered, 100 < cycle < 1000 or cycle > 1500
        if powered and not before:
            late.reset()
            default.reset()
        state = State.RUN if powered else State.DISARMED
        rows.append((tick, latency_us, state))
    columns = dict(zip(("tick", "wake_latency_us", "state"), np.array(rows, float).T, strict=True))
    result = recorded(columns, WIDE, MS)
    assert result == both(late, default)
    assert result["holds"] > 10
    assert result["on_hardware"]["stop"]["bound"] == "stop_share"


def test_lateness_that_ended_a_run_is_the_first_line(tmp_path):
    late = lived(0, 63)
    fault = {"code": 11, "name": "late_ticks", "cause": cause(late), "next_step": "do this"}
    summary = {
        "trial": "t", "estimators": [], "selected": None, "clock": "real", "duration_s": 1.0,
        "ticks": 9, "missed_ticks": 63, "late": late, "notes": [], "wake_latency_us": None,
        "work_us": None, "privileges": [fifo(granted=True).describe()],
        "adequacy": {"share_of_contact": None},
        "contact": {"surface_found": None, "surface_true": None, "onsets": 0},
        "link": dict.fromkeys(
            ("sent", "received", "lost", "overtaken", "refused", "round_trip_ms")
        ),
        "master": dict.fromkeys(
            ("nrmse", "lag_ms", "direct_reflection_lag_ms", "largest_force_step")
        ),
        "safety": {"state": "FAULT", "fault": fault},
    }  # fmt: skip
    out = io.StringIO()
    print_summary(Console(file=out, width=500), summary, silicone().rig.units)
    lines = out.getvalue().splitlines()
    assert lines[0].startswith("stopped: the loop stalled for 63.0 ms after 0.1 s under power")
    assert lines[0].endswith("; do this")
    assert all(line == line.rstrip() for line in lines), "no line is filled up with blanks"
    result = "\n".join(lines)
    assert "longest stall" in result
    assert "would have stopped after 0.1 s: 63.0 ms" in result
    assert "SCHED_FIFO granted (why)" in result
    assert "9 ticks, 63 missed (good: at most 1 of 1000)" in result
    summary |= {"clock": "simulated", "ticks": 1000, "missed_ticks": 1}
    out = io.StringIO()
    print_summary(Console(file=out, width=500), summary, silicone().rig.units)
    assert "longest stall" not in out.getvalue()
    assert "1000 ticks, 1 missed\n" in out.getvalue()
