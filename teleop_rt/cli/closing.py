"""The command that closes the loop, which is lent how a trial is loaded and run."""

from __future__ import annotations

from teleop_rt.cli.whole_run import run_in
from teleop_rt.cli.wiring import load_trial_file
from teleop_rt.offline.closing_command import close_loop_command

close_loop = close_loop_command(load_trial_file, run_in)
