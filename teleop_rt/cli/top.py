"""The options of `teleop-rt` itself: its version, and the completion of commands in a shell."""

from __future__ import annotations

from typing import Annotated, Any

import typer
from typer.main import get_command


def _print_version(asked: bool) -> None:
    if asked:
        from teleop_rt.trial.software import version_line  # noqa: PLC0415 - only where it is asked

        print(version_line())
        raise typer.Exit


def top_options() -> list[Any]:
    """Return the parameters of `teleop-rt` itself."""
    app = typer.Typer()

    @app.callback()
    def top(
        version: Annotated[
            bool,
            typer.Option(
                "--version",
                callback=_print_version,
                is_eager=True,
                help="Print version, commit, Python and numba, and exit.",
            ),
        ] = False,
    ) -> None:
        """Declare the options that `teleop-rt` takes before a command."""

    return get_command(app).params
