"""A rig's file from what is on the table: a drive, an adapter, a force sensor."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import yaml

from teleop_rt.config_loader import load_rig
from teleop_rt.errors import ExpectedError
from teleop_rt.outputs import refuse_existing
from teleop_rt.shipped import EXAMPLES, example
from teleop_rt_drivers.bus import BusConfig, open_bus
from teleop_rt_drivers.calibration.rig_file import with_values
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.framed.stream import SerialStream
from teleop_rt_drivers.registry import AXIS_SCHEMAS
from teleop_rt_drivers.scanning import can_drives, canopen_nodes, servos

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import can

    from teleop_rt_drivers.calibration.rig_file import KeyPath
    from teleop_rt_drivers.scanning.found import Found

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
SENSORS = ("wrench", "load-cell", "drive")
"""A fast force sensor, a slow one, or none: the motor's torque."""
PRESETS = {("canopen", "drive"): "simulated_canopen_drive", "canopen": "simulated_mixed"}
"""The rig that ships with a drive (and sensor), where it is not `simulated_DRIVE`."""
CANOPEN_PART = {"simulated_mixed": ("axis", "parts", "bus"), "simulated_canopen_drive": ("axis",)}
"""Where those have their CANopen devices."""
NO_SENSOR = """\
      force: from drive          # the motor's torque: its friction and mass go into drivetrain
      drivetrain:
        mass_N_s2_per_m: 0       # what the motor moves; `teleop-rt calibrate drivetrain` adds to it
"""
SCHEMA = "schema/rig.schema.json"
"""The schema by which an editor checks the file, from the file's folder."""
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
        raise NewRigError(
            "moteus needs CAN FD: take --adapter socketcan, with a controller for it that Linux "
            "shows as can0 (mjcanfd-usb does; an fdcanusb speaks lines of text: not supported)"
        )
    text = _without_sensor(drive) if sensor == "drive" else _preset(drive)
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


def _without_sensor(drive: str) -> str:
    """Return a rig whose force is the motor's torque."""
    if (drive, "drive") in PRESETS:
        return _preset((drive, "drive"))
    text = _preset(drive)
    text = text[: text.index("    sensor:\n")]
    text = text.replace(
        ", and a force sensor on a serial port.", "; the motor's torque is the force."
    )
    text = text.replace(", and a force sensor.", "; the motor's torque is the force.")
    text = text.replace("position: from drive\n", f"position: from drive\n{NO_SENSOR}", 1)
    return re.sub(r"(unsafe_i_know: \[[^]]*)\]", r"\1, force_comparison]", text, count=1)


def _preset(drive: str | tuple[str, str]) -> str:
    name = PRESETS.get(drive, f"simulated_{drive}")
    text = example("rigs", name).read_text(encoding="utf-8")
    return text.replace(f"$schema=../{SCHEMA}", f"$schema={SCHEMA}")


def with_found(
    text: str, drive: str, sensor: str, found: Sequence[Found], chosen: int | None
) -> str:
    """Return the rig's text with what devices said. Raises NewRigError for none, or too many.

    Of several drives `chosen` is the one; CANopen nodes differ by their profiles.
    """
    if not found:
        raise NewRigError(
            f"no {drive} answers: check power, wiring, termination and bit rate, and that no other "
            "program has the adapter; without --scan the file is written with the preset's ids"
        )
    if drive != "canopen":
        part: KeyPath = ("axis", "parts", "drive")
        values = _one(found, chosen).values
        return with_values(text, {(*part, *path): value for path, value in values.items()})
    part = CANOPEN_PART[PRESETS[drive, "drive"] if sensor == "drive" else PRESETS[drive]]
    wanted = ["drive"] if sensor == "drive" else ["drive", "encoder"]
    for section in wanted:
        having = [one for one in found if (section, "node_id") in one.values]
        if not having:
            named = "; ".join(one.words for one in found)
            raise NewRigError(f"no node has the profile of the {section}: {named}")
        one = _one(having, chosen if section == "drive" else None)
        if (section, "eds") not in one.values:
            raise NewRigError(
                f"{one.words}: no data sheet here is of this device; write the file without --scan,"
                f" and put in node_id {one.number}, identity, and eds: the file of its maker"
            )
        text = with_values(text, {(*part, *path): value for path, value in one.values.items()})
    return text


def _one(found: Sequence[Found], chosen: int | None) -> Found:
    """Return the device that is meant. Raises NewRigError."""
    if chosen is None and len(found) == 1:
        return found[0]
    for one in found:
        if one.number == chosen:
            return one
    named = "; ".join(one.words for one in found)
    raise NewRigError(f"{len(found)} answer: {named}: say which by --id, or connect one alone")


def scan(text: str, now_ns: Callable[[], int], drive: str) -> list[Found]:
    """Return who answers where the rig of this text has its drive. Raises AxisError."""
    part = yaml.safe_load(text)["axis"]
    part = part["parts"]["bus" if drive == "canopen" else "drive"] if "parts" in part else part
    if drive in ON_LINES:
        device = part["device"]
        path = device if device.startswith("/") else f"{part['folder']}/{device}"
        return servos.SCANS[drive](partial(SerialStream, path))
    bus = open_bus(BusConfig.model_validate(part["bus"]))
    try:
        return on_bus(bus, now_ns, drive)
    finally:
        bus.shutdown()


def on_bus(bus: can.BusABC, now_ns: Callable[[], int], drive: str) -> list[Found]:
    """Return who answers on a CAN bus."""
    if drive == "canopen":
        return canopen_nodes.nodes(bus, now_ns)
    return can_drives.SCANS[drive](can_drives.CanScan(bus, now_ns))


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
