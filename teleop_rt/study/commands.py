"""The command line of the studies."""

from __future__ import annotations

import typer

from teleop_rt.study import sweep_commands
from teleop_rt.study.delay_command import delay

app = typer.Typer(add_completion=False, no_args_is_help=True, help="Repeatable studies.")
for command in (
    sweep_commands.chapter4,
    sweep_commands.noise,
    sweep_commands.time_varying,
    sweep_commands.excitation,
    sweep_commands.approach,
    delay,
):
    app.command()(command)
