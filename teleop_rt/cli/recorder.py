"""The process that records what the others publish; it loads none of their code."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.realtime.loop import StopRequest
from teleop_rt.realtime.parent import end_with_parent, tell_parent, telling_problems
from teleop_rt.trial.recorder_main import recorder_main


def recorder(
    session: Annotated[Path, typer.Option(help="folder of the rings")],
    out: Annotated[Path, typer.Option(help="folder to write")],
) -> None:
    """Record the rings of a session."""
    with telling_problems(tell_parent):
        end_with_parent()
        tell_parent("done", **recorder_main(session, out, StopRequest(), tell_parent))
