"""CANopen nodes: those that answer, with device type (1000h) and identity (1018h)."""

from __future__ import annotations

import importlib.resources
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen import eds
from teleop_rt_drivers.canopen.sdo import ConfigurationBus, SdoNode
from teleop_rt_drivers.canopen.survey import scan
from teleop_rt_drivers.scanning.found import Found

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt_drivers.scanning.found import Value

PROFILES = {402: "drive", 406: "encoder", 404: "force"}
"""Section of the rig's file, by the profile in the low word of 1000h."""
OWN_ID = 127
"""The id that the scan leaves out as its own: the highest that CiA 301 allows."""
ANSWER_S = 0.3
"""Longest wait for an SDO answer; a node answers within milliseconds."""
KEYS = {"vendor": "0x1018:1", "product": "0x1018:2"}


def nodes(bus: can.BusABC, now_ns: Callable[[], int]) -> list[Found]:
    """Return the nodes that answer, each with the section that its profile belongs to."""
    pumped = ConfigurationBus(bus, now_ns)
    dictionary = eds.load("drive_cia402.eds", 1)
    found = []
    for number in sorted(scan(pumped, OWN_ID)):
        node = SdoNode("unknown", number, dictionary, pumped, "this bus", ANSWER_S)
        try:
            profile = int(node.read("0x1000")) & 0xFFFF
            identity = {name: int(node.read(entry)) for name, entry in KEYS.items()}
        except AxisError as error:
            found.append(Found(number, {}, f"node {number} refuses to state its type: {error}"))
            continue
        section = PROFILES.get(profile)
        words = f"node {number}, CiA {profile}, " + ", ".join(
            f"{name} {value:#x}" for name, value in identity.items()
        )
        found.append(Found(number, _values(section, number, identity), words))
    return found


def _values(
    section: str | None, number: int, identity: dict[str, int]
) -> dict[tuple[str, ...], Value]:
    if section is None:
        return {}
    values: dict[tuple[str, ...], Value] = {(section, "node_id"): number}
    for name, value in identity.items():
        values[section, "identity", name] = value
    if (file := shipped_eds(identity)) is not None:
        values[section, "eds"] = file
    return values


def shipped_eds(identity: dict[str, int]) -> str | None:
    """Return the data sheet of this package that is of such a device, None for none."""
    folder = importlib.resources.files("teleop_rt_drivers") / "eds"
    for file in sorted(folder.iterdir(), key=lambda one: one.name):
        dictionary = eds.load(file.name, 1)
        stated = [dictionary.get_variable(0x1018, place) for place in (1, 2)]
        if [one.default for one in stated if one is not None] == list(identity.values()):
            return file.name
    return None
