"""A rig's file from what is on the table: a drive, an adapter, a force sensor."""

from __future__ import annotations

import re
from pathlib import Path

from teleop_rt.config_loader import load_rig
from teleop_rt.errors import ExpectedError
from teleop_rt.outputs import refuse_existing
from teleop_rt.shipped import EXAMPLES, example
from teleop_rt_drivers.calibration.rig_file import with_values
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.registry import AXIS_SCHEMAS

ON_LINES = ("dynamixel", "feetech")
"""Drives on a serial line of their own; the others are on a CAN bus."""
DRIVES = ("odrive", "damiao", "robstride", "moteus", "vesc", *ON_LINES, "canopen")
CHANNELS = {
    "socketcan": "can0",
    "slcan": "/dev/ttyACM0",
    "gs_usb": "0",
    "pcan": "PCAN_USBBUS1",
    "serial": "ttyUSB0",
    "unix": "rig",
}
"""Adapters by their interface, and the channel that each usually has."""
SENSORS = ("wrench", "load-cell")
PRESETS = {"canopen": "simulated_mixed"}
"""The rig that ships with a drive, where it is not `simulated_DRIVE`."""
SCHEMA = "schema/rig.schema.json"
"""The schema by which an editor checks the file, from the file's folder."""
LOAD_CELL = "simulated_load_cell"
SLOW = {
    ("rate_hz",): 500.0,
    ("limits", "velocity_max_m_per_s"): 0.2,
    ("limits", "force_max_N"): 140.0,
    ("limits", "stiffness_max_N_per_m"): 4000.0,
    ("sensors", "force_lag_ms"): 27.3,
    ("sensors", "force_lag_deviation_ms"): 0.12,
}
"""Keys of a rig with a load cell of 80 samples a second, as in `simulated_load_cell`."""
LATE = re.compile(r"^realtime:\n  late: .*\n\n", re.MULTILINE)
"""Bounds on a stalled loop that only a simulated rig may have."""
FOLDER = re.compile("folder: /tmp/teleop-rt-ports.*")
"""Where a simulated rig offers its ports."""


class NewRigError(ExpectedError):
    """No rig can be made of these; says why, and what to do."""


def rig_text(drive: str, adapter: str, sensor: str, channel: str | None) -> str:
    """Return the text of a rig's file. Raises NewRigError for a combination that cannot be."""
    for what, given, known in (
        ("--drive", drive, DRIVES), ("--adapter", adapter, tuple(CHANNELS)),
        ("--sensor", sensor, SENSORS),
    ):  # fmt: skip
        if given not in known:
            raise NewRigError(f"{what} {given}: is not one of {', '.join(known)}")
    if drive in ON_LINES and adapter not in {"serial", "unix"}:
        raise NewRigError(f"{drive} is on a serial line: take --adapter serial, --channel its port")
    if drive not in ON_LINES and adapter == "serial":
        raise NewRigError(f"{drive} is on a CAN bus: take an adapter for it, such as socketcan")
    if drive == "moteus" and adapter not in {"socketcan", "unix"}:
        raise NewRigError("moteus needs CAN FD: take --adapter socketcan, with a controller for it")
    text = _preset(drive)
    text = re.sub(r"^name: .*$", f"name: {drive} on {adapter}", text, count=1, flags=re.MULTILINE)
    at = channel or CHANNELS[adapter]
    if adapter == "serial":
        text = re.sub(r"(\n +device: )servo.*", rf'\g<1>"{at}"', text)
    text = re.sub(
        r"(\n +interface: )unix.*(\n +channel: )rig.*", rf'\g<1>{adapter}\g<2>"{at}"', text
    )
    if adapter != "unix":
        text = FOLDER.sub("folder: /dev", LATE.sub("", text))
    if sensor == "load-cell":
        cell = _preset("load_cell")
        text = text[: text.index("    sensor:\n")] + cell[cell.index("    sensor:\n") :]
        text = with_values(text, SLOW)
        text = text if adapter == "unix" else FOLDER.sub("folder: /dev", text)
    return text


def _preset(drive: str) -> str:
    name = PRESETS.get(drive, f"simulated_{drive}")
    text = example("rigs", name).read_text(encoding="utf-8")
    return text.replace(f"$schema=../{SCHEMA}", f"$schema={SCHEMA}")


def write_rig(file: Path, text: str) -> None:
    """Write the rig and its schema, unless the file is there, or `check` would refuse it.

    Raises OutputError, NewRigError.
    """
    refuse_existing([file])
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text, encoding="utf-8")
    try:
        found = [one for one in check_rig(load_rig(file, AXIS_SCHEMAS)) if one.severity == "error"]
    except BaseException:
        file.unlink()
        raise
    if found:
        file.unlink()
        raise NewRigError("\n".join(map(str, found)))
    schema = file.parent / SCHEMA
    if not schema.exists():
        schema.parent.mkdir(exist_ok=True)
        schema.write_text((EXAMPLES / SCHEMA).read_text(encoding="utf-8"), encoding="utf-8")
