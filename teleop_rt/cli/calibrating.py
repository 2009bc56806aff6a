"""The commands `calibrate force`, `lag` and `device`: their arguments alone."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from typer.main import get_command

from teleop_rt.shipped import trial_file

RigFile = Annotated[Path, typer.Argument(help="the rig's YAML file", exists=True, dir_okay=False)]
Write = Annotated[
    bool, typer.Option("--write", help="write the result into the rig's file; the old file is kept")
]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object")]

Simulated = Annotated[
    Path | None,
    typer.Option(
        metavar="TRIAL",
        parser=trial_file,
        help="rehearse without hardware, on the rig of this trial (a file, or a shipped name)",
    ),
]

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Calibrate a force sensor's scale and lag, a drivetrain, or an operator's device.",
)


@app.command()
def force(
    rig_file: RigFile,
    weights: Annotated[str, typer.Option(help="masses in kg, such as 0,0.5,1; two or more")],
    seconds: Annotated[
        float, typer.Option(min=0.5, help="reading time of each weight, in seconds")
    ] = 3.0,
    lever_m: Annotated[
        float | None,
        typer.Option("--lever-m", help="lever arm of the weights on a rotary rig, in m"),
    ] = None,
    pull: Annotated[
        bool, typer.Option("--pull", help="the weights pull; by default they press")
    ] = False,
    simulated: Simulated = None,
    write: Write = False,
    as_json: Json = False,
) -> None:
    """Estimate scale, offset, linearity, noise and drift of the force sensor from weights."""
    from teleop_rt_drivers.calibration.work import calibrate_force  # noqa: PLC0415 - all drivers

    def ask(words: str) -> None:
        typer.prompt(words, "", show_default=False, err=True)

    calibrate_force(
        rig_file, weights, seconds, lever_m, ask,
        pull=pull, write=write, as_json=as_json, simulated=simulated,
    )  # fmt: skip


@app.command()
def lag(
    rig_file: RigFile,
    recording: Annotated[
        Path, typer.Argument(help="MCAP recording of a run that pressed on a spring")
    ],
    damping: Annotated[
        float | None,
        typer.Option(
            min=0, help="damping of the body, in the rig's units; a steel spring has almost none"
        ),
    ] = None,
    write: Write = False,
    as_json: Json = False,
) -> None:
    """Estimate the lag of the force, or of the drive's torque, from a press on a spring."""
    from teleop_rt_drivers.calibration.work import calibrate_lag  # noqa: PLC0415 - as above

    calibrate_lag(rig_file, recording, damping, write=write, as_json=as_json)


@app.command()
def drivetrain(
    rig_file: RigFile,
    recording: Annotated[Path, typer.Argument(help="MCAP recording of a run of this rig")],
    base: Annotated[
        str, typer.Option(help="model of the body that the run pressed on")
    ] = "kelvin-voigt",
    write: Write = False,
    as_json: Json = False,
) -> None:
    """Estimate the drivetrain's friction and mass from a run, by diagnosis."""
    from teleop_rt_drivers.calibration.work import calibrate_drivetrain  # noqa: PLC0415 - as above

    calibrate_drivetrain(rig_file, recording, base, write=write, as_json=as_json)


@app.command()
def device(
    rig_file: RigFile,
    force: Annotated[float, typer.Option(help="force that moves the device, in the rig's unit")],
    reach: Annotated[
        float, typer.Option(help="largest distance to either side, in the rig's unit")
    ],
    seconds: Annotated[float, typer.Option(min=1.0, max=60.0, help="duration of the motion")] = 4.0,
    simulated: Simulated = None,
    write: Write = False,
    as_json: Json = False,
) -> None:
    """Estimate mass, damping, friction and latency of an operator's device from a short motion."""
    from teleop_rt_drivers.calibration.work import calibrate_device  # noqa: PLC0415 - as above

    def ask(words: str) -> None:
        typer.prompt(words, "", show_default=False, err=True)

    calibrate_device(
        rig_file, force, reach, seconds, ask,
        write=write, as_json=as_json, simulated=simulated,
    )  # fmt: skip


calibrate = get_command(app)
