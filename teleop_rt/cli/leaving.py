"""The exit of a command after a fault: with cause, next step, and an exit code."""

from __future__ import annotations

import re
import sys
from typing import Any

import typer

from teleop_rt.errors import FAULT

_RESET = re.compile(r"then reset(?: and arm)?(?:; .*)?$")
"""The end of a next step that only a daemon which still runs can take."""


def leave_on_fault(safety: dict[str, Any], again: str) -> None:
    """Leave with the exit code of a fault, after printing its cause, if there was one.

    The process that could be reset ends here: `again` says how to start the next one.
    """
    fault = safety["fault"]
    if fault["code"] != 0:
        said = f" ({fault['said']})" if fault.get("said") else ""
        next_step = _RESET.sub(f"then {again}", fault["next_step"])
        print(f"stopped: {fault['cause']}{said}; {next_step}", file=sys.stderr)
        raise typer.Exit(FAULT)
