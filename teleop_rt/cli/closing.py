"""The command that closes the loop: its arguments alone, which a shell completes at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from teleop_rt.cli.options import OutFolder, Overrides
from teleop_rt.cli.recordings import (
    BASE_HELP,
    Columns,
    EffectsFile,
    Rate,
    UnitsOption,
    table_of,
)
from teleop_rt.shipped import trial_file as shipped_or_file

TrialOrNone = Annotated[
    Path | None,
    typer.Argument(
        metavar="TRIAL",
        parser=shipped_or_file,
        help="the trial: a YAML file, or the name of one that ships",
    ),
]
Recording = Annotated[
    Path | None, typer.Option(help="measured recording to diagnose, in place of a trial")
]
Test = Annotated[
    Path | None, typer.Option(help="second measured recording, on which the errors are computed")
]
Base = Annotated[
    str | None, typer.Option(help=f"base model; default: the trial's first; {BASE_HELP}")
]
Clock = Annotated[Literal["real", "simulated"], typer.Option(help="real or simulated time")]
Json = Annotated[bool, typer.Option("--json", help="print the answer as JSON")]


def close_loop(
    trial_file: TrialOrNone = None,
    recording: Recording = None,
    test: Test = None,
    base: Base = None,
    clock: Clock = "real",
    effects: EffectsFile = None,
    columns: Columns = None,
    units: UnitsOption = None,
    rate: Rate = None,
    out: OutFolder = None,
    overrides: Overrides = None,
    as_json: Json = False,
) -> None:
    """Run and diagnose a trial, extend its model, and report the errors of a fresh trial."""
    from teleop_rt.cli.reporting import felt_of  # noqa: PLC0415 - loads compilers and drivers
    from teleop_rt.cli.whole_run import run_in  # noqa: PLC0415 - loads compilers and drivers
    from teleop_rt.cli.wiring import load_trial_file  # noqa: PLC0415 - as above
    from teleop_rt.offline.closing_command import Asked, close_and_print  # noqa: PLC0415 - as above

    asked = Asked(
        trial_file=trial_file,
        recording=recording,
        test=test,
        base=base,
        clock=clock,
        effects=effects,
        table=table_of(columns, units, rate),
        out=out,
        overrides=list(overrides or []),
    )
    close_and_print(asked, load_trial_file, run_in, felt_of, as_json=as_json)
