"""Arguments and options that several commands take."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.shipped import example_names, trial_file


def _trials(incomplete: str) -> list[str]:
    """Complete the name of an example in a shell."""
    return [name for name in example_names("trials") if name.startswith(incomplete)]


class ClockName(StrEnum):
    """Which clock a run uses."""

    REAL = "real"
    SIMULATED = "simulated"


TrialFile = Annotated[
    Path,
    typer.Argument(
        metavar="TRIAL",
        parser=trial_file,
        autocompletion=_trials,
        help="the trial: a YAML file, or the name of one that ships: "
        + ", ".join(example_names("trials")),
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY.PATH=VALUE", help="override any key of the trial or rig"),
]
OutFolder = Annotated[Path | None, typer.Option("--out", help="folder to write; must be empty")]
OptionalKeyFile = Annotated[
    Path | None,
    typer.Option("--key", help="key file made by `keygen`; default of a service: its credential"),
]
JsonLines = Annotated[bool, typer.Option("--json", help="print events as lines of JSON")]
LivePort = Annotated[
    int, typer.Option("--port", min=0, max=65535, help="TCP port of the page; 0 for any")
]
