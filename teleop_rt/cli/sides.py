"""The processes of a trial, each started alone: arguments, which a shell completes at once."""

from __future__ import annotations

from typing import Annotated

import typer

from teleop_rt.cli.options import JsonLines, OptionalKeyFile, OutFolder, Overrides, TrialFile


def slave(
    trial_file: TrialFile,
    key: OptionalKeyFile = None,
    overrides: Overrides = None,
    out: OutFolder = None,
    arm: Annotated[
        bool, typer.Option("--arm", help="arm and start at once, for the trial's duration only")
    ] = False,
    as_json: JsonLines = False,
) -> None:
    """Run the slave daemon next to the rig; `arm`, `start`, `stop` and `status` command it."""
    from teleop_rt.cli.side_mains import run_slave  # noqa: PLC0415 - loads compilers and drivers

    run_slave(trial_file, key, overrides, out, arm=arm, as_json=as_json)


def master(
    trial_file: TrialFile,
    key: OptionalKeyFile = None,
    overrides: Overrides = None,
    out: OutFolder = None,
    as_json: JsonLines = False,
) -> None:
    """Run the master next to the operator until it is stopped, by Ctrl-C or SIGTERM."""
    from teleop_rt.cli.side_mains import run_master  # noqa: PLC0415 - loads compilers and drivers

    run_master(trial_file, key, overrides, out, as_json=as_json)


def sim(
    trial_file: TrialFile,
    overrides: Overrides = None,
    out: OutFolder = None,
    as_json: JsonLines = False,
) -> None:
    """Run the simulated rig: a plant, and devices that exchange real bytes."""
    from teleop_rt.cli.side_mains import run_sim  # noqa: PLC0415 - loads compilers and drivers

    run_sim(trial_file, overrides, out, as_json=as_json)


def make_safe(trial_file: TrialFile, overrides: Overrides = None) -> None:
    """Stop the axis of a rig that no daemon runs: systemd calls this after a daemon has ended."""
    from teleop_rt.cli.side_mains import make_rig_safe  # noqa: PLC0415 - loads drivers

    make_rig_safe(trial_file, overrides)
