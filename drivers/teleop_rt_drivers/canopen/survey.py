"""Survey of a CANopen bus by SDO alone: the devices on it, each compared with its EDS."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from canopen.objectdictionary import ObjectDictionary, ODVariable

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen import build, eds, setup
from teleop_rt_drivers.canopen.sdo import ConfigurationBus, SdoNode
from teleop_rt_drivers.findings import Finding

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt_drivers.canopen.config import CanopenPart

ANSWER_WAIT_S = 0.01
"""Wait for an answer to each question of a scan."""
READ_DEVICE_TYPE = bytes((0x40, 0x00, 0x10, 0, 0, 0, 0, 0))
SDO_REQUEST, SDO_ANSWER = 0x600, 0x580  # COB-IDs without the node's id (CiA 301)
NODES = range(1, 128)
IDENTITY = {1: "vendor", 2: "product", 3: "revision"}
MOST_NAMED = 6
"""Errors printed one by one; of more, the rest is an ellipsis."""
SILENT_BUS, NO_ANSWER = "bus", "not answer"
"""Place, and end of the cause, of the error on nodes that do not answer."""
FIXED = (0x1000, 0x1018)
"""Objects whose EDS value the device must have."""


def survey(config: CanopenPart, bus: can.BusABC, now_ns: Callable[[], int]) -> list[Finding]:
    """Return the nodes that answer on a bus, and their differences from their EDS."""
    pumped = ConfigurationBus(bus, now_ns)
    try:
        setup.refuse_other_masters(pumped, config)
        found = scan(pumped, own=config.daemon.node_id)
    except AxisError as error:
        return [Finding("error", str(error), "bus", "follow this message, then run doctor again")]
    dictionaries = {n: eds.load(node.eds, node.node_id) for n, node in config.nodes.items()}
    nodes = build.sdo_nodes(config, dictionaries, pumped)
    known = {node.node_id for node in nodes.values()}
    findings = _silent([node for node in nodes.values() if node.node_id not in found])
    for node in nodes.values():
        if node.node_id in found:
            findings += [_presence(node), _against_eds(node)]
    for unlisted in sorted(found - known):
        findings.append(_unlisted(unlisted, dictionaries, pumped))
    return findings


def _silent(nodes: Sequence[SdoNode]) -> list[Finding]:
    """Return one error on all nodes that do not answer: their cause is mostly the same."""
    if not nodes:
        return []
    *others, last = (node.label for node in nodes)
    who = f"{', '.join(others)} and {last} do" if others else f"{last} does"
    step = "check power, wiring, termination, bit rate and node id"
    return [Finding("error", f"{who} {NO_ANSWER}", SILENT_BUS, step)]


def scan(bus: ConfigurationBus, own: int) -> set[int]:
    """Return the nodes that answer a question for their device type (1000h)."""
    found: set[int] = set()

    def note(message: can.Message) -> bool:
        if SDO_ANSWER < message.arbitration_id < SDO_REQUEST:
            found.add(message.arbitration_id - SDO_ANSWER)
        return False

    for node in NODES:
        if node != own:
            bus.send(SDO_REQUEST + node, READ_DEVICE_TYPE)
            bus.wait(note, ANSWER_WAIT_S)
    return found


def _identity(node: SdoNode) -> str:
    """Return the identity that a device reports (1018h)."""
    parts = []
    for subindex, name in IDENTITY.items():
        try:
            parts.append(f"{name} {int(node.read(f'0x1018:{subindex}')):#x}")
        except AxisError:
            parts.append(f"no {name}")
    return ", ".join(parts)


def _presence(node: SdoNode) -> Finding:
    return Finding("ok", f"{node.label} answers: {_identity(node)}", "bus")


def _unlisted(
    node_id: int, dictionaries: dict[str, ObjectDictionary], bus: ConfigurationBus
) -> Finding:
    """Describe a node that the rig does not name; 1018h is the same in every EDS."""
    dictionary = next(iter(dictionaries.values()))
    node = SdoNode("unknown", node_id, dictionary, bus, "this bus", 0.1)
    what = f"node 0x{node_id:02X} answers and is not one of the rig's: {_identity(node)}"
    return Finding("warning", what, "bus", "name it in the rig, or take it off the bus")


def _against_eds(node: SdoNode) -> Finding:
    """Read every entry that the EDS says is there, and compare the ones that must not differ."""
    wrong: list[str] = []
    checked = 0
    for entry in _readable(node.dictionary):
        checked += 1
        name = f"{entry.index:04X}h:{entry.subindex}"
        try:
            data = node.upload(entry.index, entry.subindex)
        except AxisError as error:
            wrong.append(f"{name} ({error})")
            continue
        if entry.fixed_size and 8 * len(data) != len(entry):
            wrong.append(f"{name} has {8 * len(data)} bits, not {len(entry)}")
        elif entry.index in FIXED and entry.default not in (None, 0, entry.decode_raw(data)):
            wrong.append(f"{name} is {entry.decode_raw(data)!r}, not {entry.default!r}")
    if not wrong:
        return Finding("ok", f"{node.label} has all {checked} entries of its EDS", "EDS")
    shown = "; ".join(wrong[:MOST_NAMED]) + ("; ..." if len(wrong) > MOST_NAMED else "")
    what = f"{node.label} differs from its EDS in {len(wrong)} of {checked} entries: {shown}"
    return Finding("error", what, "EDS", "get the EDS of this device and firmware from its maker")


def _readable(dictionary: ObjectDictionary) -> list[ODVariable]:
    """Return the readable entries, without those that only count subindices."""
    entries: list[ODVariable] = []
    for item in dictionary.values():
        members = [item] if isinstance(item, ODVariable) else list(item.values())
        entries += [member for member in members if member.readable]
    return entries
