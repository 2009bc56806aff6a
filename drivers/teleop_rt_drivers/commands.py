"""The commands `check` and `doctor`: their arguments alone, which a shell completes at once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from teleop_rt.shipped import config_file

CYCLES = 2000
"""Cycles for which `doctor` reads the devices, by default."""

ConfigFile = Annotated[
    Path,
    typer.Argument(
        metavar="CONFIG",
        parser=config_file,
        help="a trial or a rig: a YAML file, or the name of one that ships",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object")]
Overrides = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY.PATH=VALUE", help="override any key of a trial or its rig"),
]


def check(config: ConfigFile, overrides: Overrides = None, as_json: Json = False) -> None:
    """Check a config without moving anything: descriptions, limits, units, bus load."""
    from teleop_rt_drivers.examination import check_config  # noqa: PLC0415 - loads all drivers

    check_config(config, overrides, as_json=as_json)


def doctor(
    config: ConfigFile,
    overrides: Overrides = None,
    cycles: Annotated[
        int, typer.Option(min=20, help="number of cycles in which the devices are read")
    ] = CYCLES,
    as_json: Json = False,
) -> None:
    """Measure the machine, and a rig's buses, devices and link; nothing is armed."""
    from teleop_rt_drivers.examination import examine  # noqa: PLC0415 - as above

    examine(config, overrides, cycles, as_json=as_json)
