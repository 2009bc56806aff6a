"""The command that runs a whole trial: its arguments alone, which a shell completes at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.cli.options import ClockName, LivePort, Overrides, TrialFile


def run(
    trial_file: TrialFile,
    clock: Annotated[ClockName, typer.Option(help="real or simulated time")] = ClockName.REAL,
    duration: Annotated[
        float | None, typer.Option(help="duration in seconds; default: the trial's")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(help="seed of all random numbers; default: the trial's")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="folder to write; must be empty")] = None,
    overrides: Overrides = None,
    as_json: Annotated[bool, typer.Option("--json", help="print the summary as JSON")] = False,
    live_page: Annotated[
        bool, typer.Option("--live", help="show the run in a browser (extra live)")
    ] = False,
    port: LivePort = 5006,
) -> None:
    """Run a whole trial: rig, slave, master and recorder, then the summary."""
    from teleop_rt.cli.whole_run import (  # noqa: PLC0415 - loads compilers and drivers
        names_as_typed,
        run_and_print,
    )

    typed = {}
    if duration is not None:
        typed[f"duration_s={float(duration)!r}"] = f"--duration {duration:g}"
    if seed is not None:
        typed[f"seed={seed}"] = f"--seed {seed}"
    changes = [*(overrides or []), *typed]
    live_port = port if live_page else None
    with names_as_typed(typed):
        run_and_print(trial_file, changes, clock, out, live_port, as_json=as_json)
