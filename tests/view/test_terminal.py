"""The display of `run` on the terminal."""

import io
import json
import re

from rich.console import Console

from teleop_rt.cli.wiring import open_bench
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.trial.summary import summarise
from teleop_rt.view.terminal import RunView
from teleop_rt_dev.trial.files import SILICONE, silicone


def shown_by(folder, duration_s, **options):
    folder.mkdir()
    text = io.StringIO()
    console = Console(file=text, width=120, **options)
    trial = silicone(f"duration_s={duration_s}")
    with RunView(console, trial.name, trial.duration_s) as view:
        run_lockstep(trial, SILICONE, open_bench, folder, view)
    return text.getvalue()


def test_elsewhere_than_on_a_terminal_two_plain_lines_show_state_force_model_and_link(tmp_path):
    start, line, machine = shown_by(tmp_path / "plain", 5.1).splitlines()
    assert start == "silicone_cube: starting ..."
    assert line.startswith("   5.0 s  RUN  ")
    assert " N at " in line
    assert "in contact" in line
    assert re.search(r"Kelvin-Voigt, k = 3[\d.]+ ± [\d.]+ N/m, b = ", line)
    assert "  1000 Hz, 0 of the last" in machine
    assert "ms one way" in machine
    assert re.search(r"ms one way, \d+ of \d+ models arrived, jitter", machine)
    assert max(map(len, (line, machine))) < 120
    assert "\x1b" not in line + machine


def test_a_blackout_is_reported_on_the_terminal_in_the_summary_and_in_the_log(tmp_path):
    folder = tmp_path / "dark"
    trial = silicone("duration_s=5.2", "link.loss=0.05", "link.blackouts_s=[[1.0,1.8],[2.2,5.2]]")
    text = io.StringIO()
    folder.mkdir()
    with RunView(Console(file=text, width=300), trial.name, trial.duration_s) as view:
        outcome = run_lockstep(trial, SILICONE, open_bench, folder, view)
    line = text.getvalue().splitlines()[-1]
    assert "link: declutched" in line or "declutched, nothing accepted for" in line
    assert "% lost" in line
    assert re.search(r"2 freezes, 1 declutch\b", line)
    summary = summarise(folder, trial, outcome, None)
    counted = {"engagements": 1, "freezes": 2, "declutches": 1}
    assert summary["master"]["rendering"]["engagement"] == counted
    assert summary["safety"]["followings"] == 2
    assert summary["safety"]["holds"] == 2
    notes = "; ".join(summary["notes"])
    assert "froze the master's target 2 times" in notes
    assert "declutched and let the force fade 1 times" in notes
    log = [json.loads(one) for one in (folder / "log.jsonl").read_text().splitlines()]
    states = [event["state"] for event in log if event["event"] == "engagement"]
    assert states[:5] == ["ENGAGED", "FROZEN", "ENGAGED", "FROZEN", "DECLUTCHED"]


def test_on_a_terminal_the_glance_renews_itself_and_is_taken_away(tmp_path):
    text = shown_by(tmp_path / "terminal", 1.5, force_terminal=True)
    assert "silicone_cube" in text
    assert "/ 1.5 s" in text
    assert "Kelvin-Voigt" in text or "none yet" in text
    assert text.rstrip().endswith("\x1b[2K") or "\x1b[1A\x1b[2K" in text
