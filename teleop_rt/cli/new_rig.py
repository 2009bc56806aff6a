"""The command that writes a file for the devices on the table: its arguments alone."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.errors import ExpectedError

DRIVE = "odrive, damiao, cybergear, robstride, moteus, vesc, dynamixel, feetech, canopen"
ADAPTER = "socketcan, slcan, fdcanusb, gs_usb, pcan; serial for servos; unix for the simulated rig"
SENSOR = (
    "wrench (fast, serial), load-cell (80 samples/s, serial), drive (the motor's torque), or "
    "drive-input (wired to an analog input; canopen)"
)


Handle = Annotated[
    bool,
    typer.Option("--handle", help="an operator's device made of one drive, without a force sensor"),
]
Position = Annotated[
    str | None,
    typer.Option(help="source of the position: drive, or encoder (canopen: a node of its own)"),
]
Channel = Annotated[str | None, typer.Option(help="the adapter's channel, such as can0 or ttyUSB0")]
SensorPort = Annotated[
    str | None, typer.Option("--sensor-port", help="the force sensor's serial port, as ttyUSB0")
]
Eds = Annotated[Path | None, typer.Option(help="canopen: the drive's EDS, from its maker")]
Scan = Annotated[
    bool,
    typer.Option(
        "--scan",
        help="identify the devices on the bus and write their answers into the file; moves nothing",
    ),
]
Chosen = Annotated[
    int | None, typer.Option("--id", help="with --scan: id of the drive, if several answer")
]


class UnansweredError(ExpectedError):
    """An option is missing and nobody can be asked; names it and its values."""


def new_rig(
    file: Annotated[Path, typer.Argument(help="rig's file to write, such as my_rig.yaml")],
    drive: Annotated[str | None, typer.Option(help=DRIVE)] = None,
    adapter: Annotated[str | None, typer.Option(help=ADAPTER)] = None,
    sensor: Annotated[str | None, typer.Option(help=SENSOR)] = None,
    position: Position = None,
    handle: Handle = False,
    channel: Channel = None,
    sensor_port: SensorPort = None,
    eds: Eds = None,
    scan: Scan = False,
    chosen: Chosen = None,
) -> None:
    """Write a rig file for a drive, an adapter and a force sensor; asks for missing options."""
    from teleop_rt_drivers import new_rig as made  # noqa: PLC0415 - loads all drivers
    from teleop_rt_drivers.rig_text import refuse_unknown_kinds  # noqa: PLC0415 - as above

    refuse_unknown_kinds(drive, adapter, sensor)
    known = {"--drive": (drive, DRIVE), "--adapter": (adapter, ADAPTER)}
    known |= {} if handle else {"--sensor": (sensor, SENSOR)}
    missing = [f"{option} ({kinds})" for option, (given, kinds) in known.items() if given is None]
    if missing and not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise UnansweredError(f"{file}: not written: give {', '.join(missing)}")
    drive = drive or _ask("drive", DRIVE, "odrive")
    adapter = adapter or _ask("adapter", ADAPTER, "socketcan")
    if not handle:
        sensor = sensor or _ask("force sensor", SENSOR, "wrench")
    text = _text(drive, adapter, None if handle else sensor, channel, position, sensor_port)
    if eds is not None:
        text = made.with_eds(text, eds, print)
    if scan or (missing and typer.confirm("ask now who is there (nothing moves)?", default=True)):
        found = made.scan(text, time.monotonic_ns, drive)
        for one in found:
            print(f"found: {one.words}")
        text = made.with_found(text, drive, found, chosen)
    made.write_rig(file, text)
    print(file)
    print(f"next: {_next_step(file, adapter, handle=handle)}")


def _text(
    drive: str,
    adapter: str,
    sensor: str | None,
    channel: str | None,
    position: str | None,
    sensor_port: str | None,
) -> str:
    """Return the text of a rig, or without a sensor of an operator's device."""
    from teleop_rt_drivers import rig_text  # noqa: PLC0415 - loads all drivers
    from teleop_rt_drivers.placeholders import with_placeholders  # noqa: PLC0415 - as above

    if sensor is None:
        if sensor_port is not None:
            raise rig_text.NewRigError(
                f"--sensor-port {sensor_port}: a handle has no force sensor: leave it out"
            )
        text = rig_text.handle_text(drive, adapter, channel)
    else:
        text = rig_text.rig_text(drive, adapter, sensor, channel, position, sensor_port)
    return (
        text if adapter == "unix" else with_placeholders(text, port_known=sensor_port is not None)
    )


def _next_step(file: Path, adapter: str, *, handle: bool) -> str:
    """Return the next step with a new rig: a simulated one runs, another lacks its own values."""
    if adapter != "unix":
        return "put in your own values for its placeholders, then teleop-rt check and doctor"
    side, trial = ("operator.rig", "serial_handle") if handle else ("rig", "silicone_cube")
    return f"teleop-rt run {trial} --set {side}={file.resolve()}"


def _ask(what: str, known: str, default: str) -> str:
    """Ask on a terminal which of the known there is."""
    answer: str = typer.prompt(f"which {what}: {known}", default=default)
    return answer.strip()
