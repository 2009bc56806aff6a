"""The exit of a command after a fault: with cause, next step, and an exit code."""

from __future__ import annotations

import sys
from typing import Any

import typer

from teleop_rt.errors import FAULT


def leave_on_fault(safety: dict[str, Any]) -> None:
    """Leave with the exit code of a fault, after printing its cause, if there was one."""
    fault = safety["fault"]
    if fault["code"] != 0:
        said = f" ({fault['said']})" if fault.get("said") else ""
        print(f"stopped: {fault['cause']}{said}; {fault['next_step']}", file=sys.stderr)
        raise typer.Exit(FAULT)
