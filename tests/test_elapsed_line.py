"""The line that shows how long a measurement goes on, without a thread beside it."""

import io
import sys
import threading
import time

import pytest
import typer

from teleop_rt.shipped import trial_file
from teleop_rt.terminal import ElapsedLine
from teleop_rt_drivers import examination
from teleop_rt_drivers.findings import Finding


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
