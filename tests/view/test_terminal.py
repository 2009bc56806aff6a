"""What `run` shows as it goes."""

import io

from rich.console import Console
from trial_files import SILICONE, silicone

from teleop_rt.cli.wiring import open_bench
from teleop_rt.trial.lockstep_run import run_lockstep
from teleop_rt.view.terminal import RunView


def shown_by(folder, **options):
    folder.mkdir()
    text = io.StringIO()
    console = Console(file=text, width=120, **options)
    trial = silicone("duration_s=5.5")
    with RunView(console, trial.name, trial.duration_s) as view:
        run_lockstep(trial, SILICONE, open_bench, folder, view)
    return text.getvalue()


def test_elsewhere_than_on_a_terminal_a_plain_line_tells_state_force_model_and_link(tmp_path):
    (line,) = shown_by(tmp_path / "plain").splitlines()
    assert line.startswith("   5.0 s  RUN  ")
    assert " N at " in line
    assert "in contact" in line
    assert "Kelvin-Voigt, k 3" in line
    assert "loop at 1000 Hz, 0 of the last" in line
    assert "ms one way" in line
    assert "\x1b" not in line


def test_on_a_terminal_the_glance_renews_itself_and_is_taken_away(tmp_path):
    text = shown_by(tmp_path / "terminal", force_terminal=True)
    assert "silicone_cube" in text
    assert "/ 5.5 s" in text
    assert "Kelvin-Voigt" in text or "none yet" in text
    assert text.rstrip().endswith("\x1b[2K") or "\x1b[1A\x1b[2K" in text
