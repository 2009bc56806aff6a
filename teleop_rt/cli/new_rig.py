"""The command that writes a rig's file from what is on the table: its arguments alone."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.errors import ExpectedError

DRIVE = "odrive, damiao, robstride, moteus, vesc, dynamixel, feetech, canopen"
ADAPTER = "socketcan, slcan, gs_usb, pcan; serial for servos; unix for the simulated rig"
SENSOR = "wrench (fast, serial) or load-cell (80 samples/s, serial)"


class UnansweredError(ExpectedError):
    """An option is missing and nobody can be asked; names it and its values."""


def new_rig(
    file: Annotated[Path, typer.Argument(help="rig's file to write, such as my_rig.yaml")],
    drive: Annotated[str | None, typer.Option(help=DRIVE)] = None,
    adapter: Annotated[str | None, typer.Option(help=ADAPTER)] = None,
    sensor: Annotated[str | None, typer.Option(help=SENSOR)] = None,
    channel: Annotated[
        str | None, typer.Option(help="the adapter's channel, such as can0 or ttyUSB0")
    ] = None,
) -> None:
    """Write a rig file for a drive, an adapter and a force sensor; asks for missing options."""
    from teleop_rt_drivers.new_rig import rig_text, write_rig  # noqa: PLC0415 - loads all drivers

    known = {
        "--drive": (drive, DRIVE),
        "--adapter": (adapter, ADAPTER),
        "--sensor": (sensor, SENSOR),
    }
    missing = [f"{option} ({kinds})" for option, (given, kinds) in known.items() if given is None]
    if missing and not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UnansweredError(f"{file}: not written: give {', '.join(missing)}")
    text = rig_text(
        drive or _ask("drive", DRIVE, "odrive"),
        adapter or _ask("adapter", ADAPTER, "socketcan"),
        sensor or _ask("force sensor", SENSOR, "wrench"),
        channel,
    )
    write_rig(file, text)
    print(file)
    print("next: put in ids, scales and limits of your devices, then teleop-rt check and doctor")


def _ask(what: str, known: str, default: str) -> str:
    """Ask on a terminal which of the known there is."""
    answer: str = typer.prompt(f"which {what}: {known}", default=default)
    return answer.strip()
