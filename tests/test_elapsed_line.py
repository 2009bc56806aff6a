"""The line that shows how long a measurement goes on, without a thread beside it."""

import io
import sys
import threading
import time

import pytest
import typer

from teleop_rt.config.loader import load_rig
from teleop_rt.shipped import trial_file
from teleop_rt.terminal import ElapsedLine
from teleop_rt_dev.paths import RIGS
from teleop_rt_drivers import examination
from teleop_rt_drivers.findings import Finding
from teleop_rt_drivers.machine_check import examine_machine
from teleop_rt_drivers.pace import paced
from teleop_rt_drivers.registry import AXIS_SCHEMAS


class Screen(io.StringIO):
    def isatty(self):
        return True


def watched(monkeypatch) -> Screen:
    """Put a screen in the place of standard error, which pytest sets again before each test."""
    shown = Screen()
    monkeypatch.setattr(sys, "stderr", shown)
    return shown


def test_the_line_is_rewritten_twice_a_second_and_taken_away(monkeypatch):
    screen, now_s = watched(monkeypatch), 100.0
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    threads = threading.active_count()
    with ElapsedLine("measuring the link") as line:
        for _ in range(2048):
            now_s += 2.0**-10  # no rounding
            line.tick()
        assert threading.active_count() == threads
    *shown, taken_away = screen.getvalue().split("\r")[1:]
    assert shown == [f"measuring the link ... {s} s" for s in ("0.0", "0.5", "1.0", "1.5", "2.0")]
    assert taken_away == "\x1b[K"


def test_nothing_is_written_where_nobody_watches(monkeypatch):
    log = io.StringIO()
    monkeypatch.setattr(sys, "stderr", log)
    with ElapsedLine("measuring the link") as line:
        line.tick()
    assert log.getvalue() == ""


def test_doctor_names_each_measurement_while_it_lasts(monkeypatch, capsys):
    """The findings go to standard output, which stays free of these lines."""
    screen, found = watched(monkeypatch), Finding("ok", "seen", "here")

    def measured(*arguments, between=None, **_):
        """Wait once, as each measurement does in its loop."""
        (between or next(one for one in arguments if getattr(one, "__name__", "") == "wait"))()
        return [found]

    for name in ("examine_machine", "examine_axis", "examine_link"):
        monkeypatch.setattr(examination, name, measured)
    monkeypatch.setattr(examination, "survey_buses", lambda *_: [found])
    with pytest.raises(typer.Exit):  # no device has answered
        examination.examine(trial_file("silicone_cube"), [], 20, as_json=False)
    lines = [line for line in screen.getvalue().split("\r") if line and line != "\x1b[K"]
    assert [line.partition(" ...")[0] for line in lines] == [
        "measuring how late a bare loop wakes",
        "asking who answers on the buses",
        "reading the devices",
        "measuring the link",
    ]
    assert "..." not in capsys.readouterr().out


def test_each_cycle_of_a_measurement_renews_its_line(monkeypatch):
    now_s = 100.0
    screen = watched(monkeypatch)
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    with paced("reading 0.5 kg", 1000) as pace:
        for _ in range(3):
            now_s += 0.5
            pace.wait()
    assert screen.getvalue().count("reading 0.5 kg") == 4


def test_the_bare_loop_of_the_machine_renews_its_line_each_tick(monkeypatch):
    rig = load_rig(RIGS / "simulated_canopen.yaml", AXIS_SCHEMAS)
    renewed = []
    examine_machine(rig, seconds=0.02, between=lambda: renewed.append(1))
    assert 1 <= len(renewed) <= 20
