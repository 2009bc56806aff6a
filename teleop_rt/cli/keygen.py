"""The command that makes a key."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.link.keys import generate_key


def keygen(
    path: Annotated[Path, typer.Argument(help="file to create, readable only by you")],
    operator: Annotated[
        str | None,
        typer.Option(help="name of the operator; append the line to the rig's key file"),
    ] = None,
) -> None:
    """Make a key for the link; both sides need the same."""
    generate_key(path, operator)
    print(path)
    if operator is None:
        print("next: copy it to both machines, and give it to each side with --key")
    else:
        print(f"next: give it to {operator}, and append its line to the rig's key file")
