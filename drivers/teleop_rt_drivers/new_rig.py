"""Write a rig file for the devices at hand, with the values that they report."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from teleop_rt.config.loader import load_rig
from teleop_rt.outputs import refuse_existing
from teleop_rt.realtime.rig_locks import devices_held
from teleop_rt.shipped import EXAMPLES
from teleop_rt_drivers.bus import BusConfig, open_bus
from teleop_rt_drivers.calibration.rig_file import with_values
from teleop_rt_drivers.canopen.eds_drive import drive_of
from teleop_rt_drivers.check import check_rig
from teleop_rt_drivers.framed.stream import SerialStream
from teleop_rt_drivers.placeholders import without_placeholders
from teleop_rt_drivers.registry import AXIS_SCHEMAS
from teleop_rt_drivers.rig_text import ON_LINES, SCHEMA, NewRigError
from teleop_rt_drivers.scanning import can_drives, canopen_nodes, servos

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import can

    from teleop_rt_drivers.calibration.rig_file import KeyPath
    from teleop_rt_drivers.scanning.found import Found, Value


def with_found(text: str, drive: str, found: Sequence[Found], chosen: int | None) -> str:
    """Return the rig's text with the devices' values. Raises NewRigError for none, or too many.

    Of several drives `chosen` is the one; CANopen nodes differ by their profiles.
    """
    if not found:
        raise NewRigError(
            f"no {drive} answers: check power, wiring, termination and bit rate, and that no other "
            "program has the adapter; without --scan the file is written with the preset's ids"
        )
    part, section = device_part(text, drive)
    if drive != "canopen":
        values = _one(found, chosen).values
        return _with_own(text, part, values)
    for name in ("drive", "encoder"):
        if not isinstance(section.get(name), dict):
            continue
        having = [one for one in found if (name, "node_id") in one.values]
        if not having:
            named = "; ".join(one.words for one in found)
            raise NewRigError(
                f"no node has the profile of the {name}: {named}: connect it, or leave --scan out"
            )
        one = _one(having, chosen if name == "drive" else None)
        if (name, "eds") not in one.values and not _is_of(section[name], one, name):
            raise NewRigError(
                f"{one.words}: no data sheet here is of this device: give that of its maker by "
                f"--eds FILE (a drive), or write the file without --scan, and put in node_id "
                f"{one.number}, identity, and eds: the file of its maker"
            )
        text = _with_own(text, part, one.values)
    return text


def _with_own(text: str, part: KeyPath, values: Mapping[KeyPath, Value]) -> str:
    """Return a rig's text with values of a device itself, which are no placeholders any more."""
    own = {(*part, *path): value for path, value in values.items()}
    return without_placeholders(with_values(text, own), own)


def _is_of(section: dict[str, Any], one: Found, name: str) -> bool:
    """Return whether the section's identity is that which the device reports."""
    stated = section["identity"]
    return all(one.values.get((name, "identity", key)) == stated[key] for key in stated)


def device_part(text: str, drive: str) -> tuple[KeyPath, dict[str, Any]]:
    """Return the places of bus and devices in a rig's text, and their contents."""
    path: KeyPath = ("axis",)
    if drive == "canopen":
        path = ("axis", "parts", "bus") if "\n  parts:\n" in text else path
    elif "\n  parts:\n" in text:
        path = ("axis", "parts", "drive")
    elif "\n  drive:\n" in text:
        path = ("axis", "drive")
    section = yaml.safe_load(text)
    for key in path:
        section = section[key]
    return path, section


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
    """Return the devices that answer on the bus or line of the drive.

    Raises AxisError, and BusyError while another process holds the bus or line.
    """
    _, part = device_part(text, drive)
    if drive in ON_LINES:
        device = part["device"]
        path = device if device.startswith("/") else f"{part['folder']}/{device}"
        with devices_held([path]):
            return servos.SCANS[drive](partial(SerialStream, path))
    config = BusConfig.model_validate(part["bus"])
    with devices_held([str(config)]):
        bus = open_bus(config)
        try:
            return on_bus(bus, now_ns, drive)
        finally:
            bus.shutdown()


def on_bus(bus: can.BusABC, now_ns: Callable[[], int], drive: str) -> list[Found]:
    """Return the devices that answer on a CAN bus."""
    if drive == "canopen":
        return canopen_nodes.nodes(bus, now_ns)
    return can_drives.SCANS[drive](can_drives.CanScan(bus, now_ns))


def with_eds(text: str, file: Path, note: Callable[[str], None]) -> str:
    """Return a CANopen rig's text for the drive of an EDS; `note` takes the remaining steps.

    Raises NewRigError for a rig without CANopen drive, AxisError for an EDS that is of none.
    """
    if "driver: canopen" not in text:
        raise NewRigError("--eds is for --drive canopen: give that, or leave it out")
    part, section = device_part(text, "canopen")
    read = drive_of(file, section["drive"])
    for line in read.notes:
        note(line)
    return _with_own(text, part, read.values)


def write_rig(file: Path, text: str) -> None:
    """Write the rig and its schema, unless the file is there, or `check` would refuse it.

    Raises OutputError, NewRigError.
    """
    refuse_existing([file])
    file.parent.mkdir(parents=True, exist_ok=True)
    try:
        file.write_text(text, encoding="utf-8")
        found = [one for one in check_rig(load_rig(file, AXIS_SCHEMAS)) if one.severity == "error"]
    except BaseException:
        file.unlink(missing_ok=True)
        raise
    if found:
        file.unlink()
        raise NewRigError("\n".join(map(str, found)))
    schema = file.parent / SCHEMA
    if not schema.exists():
        schema.parent.mkdir(exist_ok=True)
        schema.write_text((EXAMPLES / SCHEMA).read_text(encoding="utf-8"), encoding="utf-8")
