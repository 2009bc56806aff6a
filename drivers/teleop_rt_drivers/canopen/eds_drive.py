"""A CiA 402 drive in a rig's file, read from its EDS: identity, process data objects, setup.

Which objects the daemon reads and writes is that of `setup.py`; an EDS without them is refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from canopen.objectdictionary import ODVariable

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen import cia402, eds
from teleop_rt_drivers.canopen.entries import address
from teleop_rt_drivers.canopen.pdo import (
    FORMATS,
    RPDO_COMMUNICATION,
    RPDO_MAPPING,
    TPDO_COMMUNICATION,
    TPDO_MAPPING,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from canopen.objectdictionary import ObjectDictionary

PROFILE = 402  # number of CiA's profile for drives, in 1000h
NEEDED = (
    "0x6040", "0x6041", "0x6060", "0x6061", "0x6064", "0x607A", "0x607D:1", "0x607D:2", "0x607F",
    "0x60C2:1", "0x60C2:2", "0x6502", "0x1016:1",
)  # fmt: skip
TAKEN = ("0x6040", "0x607A")
SENT = ("0x6041", "0x6077", "0x6064")
PDOS = 512
"""PDOs that CiA 301 knows each way: 1400h to 15FFh, 1800h to 19FFh."""
SPEED_UNIT = "0x60A9"
ANALOG = re.compile(r"analogu?e?\b.*\bin", re.IGNORECASE)
"""Names of objects with an analog input's value, which no profile of drives gives a place to."""


@dataclass(frozen=True, slots=True)
class EdsDrive:
    """Values of the rig's section `drive`, and lines for its owner."""

    values: dict[tuple[str, ...], str | int]
    notes: tuple[str, ...]


def drive_of(file: Path, section: dict[str, Any]) -> EdsDrive:
    """Return a drive as its EDS describes it; `section` is the rig's own. Raises AxisError."""
    name = str(file.resolve())
    dictionary = eds.load(name, 1)
    _refuse_another_profile(dictionary, file.name)
    values: dict[tuple[str, ...], str | int] = {("drive", "eds"): f'"{name}"'}
    for key, value in _identity(dictionary, file.name).items():
        values["drive", "identity", key] = value
    _refuse_unmapped(dictionary, file.name)
    values["drive", "rpdo"] = _pdo(dictionary, TAKEN, RPDO_COMMUNICATION, RPDO_MAPPING, file.name)
    values["drive", "tpdo"] = _pdo(dictionary, SENT, TPDO_COMMUNICATION, TPDO_MAPPING, file.name)
    setup, notes = _setup(dictionary, section.get("setup", {}))
    if (wired := section.get("force_input")) is not None:
        entry, note = _input(dictionary, wired["force"], file.name)
        values["drive", "force_input", "force"] = f'"{entry}"'
        values["drive", "force_input", "tpdo"] = _pdo(
            dictionary, (entry,), TPDO_COMMUNICATION, TPDO_MAPPING, file.name, 1
        )
        notes.append(note)
    values["drive", "setup"] = f"{{{setup}}}"
    return EdsDrive(values, (*notes, *_numbers(dictionary)))


def _variable(dictionary: ObjectDictionary, entry: str) -> ODVariable | None:
    found: ODVariable | None = dictionary.get_variable(*address(entry))
    return found


def _refuse_another_profile(dictionary: ObjectDictionary, name: str) -> None:
    """Refuse all but a CiA 402 drive with cyclic synchronous position."""
    kind = _variable(dictionary, "0x1000")
    if kind is not None and kind.default and kind.default & 0xFFFF != PROFILE:
        raise AxisError(
            f"{name}: is of a device of CiA {kind.default & 0xFFFF}, not of a drive"
            ": name the EDS of the drive"
        )
    missing = [entry for entry in NEEDED if _variable(dictionary, entry) is None]
    if missing:
        raise AxisError(
            f"{name}: lacks {', '.join(missing)}, which the daemon needs of a drive"
            ": take another drive, or its maker's complete EDS"
        )
    modes = _variable(dictionary, "0x6502")
    bit = cia402.MODE_CYCLIC_SYNCHRONOUS_POSITION - 1
    if modes is not None and modes.default and not modes.default >> bit & 1:
        raise AxisError(
            f"{name}: this drive has no cyclic synchronous position (6502h, bit {bit})"
            ": take a drive that has it"
        )


def _identity(dictionary: ObjectDictionary, name: str) -> dict[str, int]:
    """Return vendor and product, by 1018h or the file's [DeviceInfo]."""
    about = dictionary.device_information
    stated = {"vendor": ("0x1018:1", about.vendor_number),
              "product": ("0x1018:2", about.product_number)}  # fmt: skip
    identity = {}
    for key, (entry, number) in stated.items():
        found = _variable(dictionary, entry)
        value = (found.default if found is not None else None) or number
        if not value:
            raise AxisError(f"{name}: has no {key} in {entry} or in [DeviceInfo]: put it in")
        identity[key] = int(value)
    return identity


def _refuse_unmapped(dictionary: ObjectDictionary, name: str) -> None:
    for entry in (*TAKEN, *SENT):
        found = _variable(dictionary, entry)
        if found is None or not found.pdo_mappable or found.data_type not in FORMATS:
            raise AxisError(
                f"{name}: {entry} cannot be mapped into a PDO, which the daemon needs"
                ": take another drive"
            )


def _pdo(
    dictionary: ObjectDictionary, objects: tuple[str, ...], communication: int, mapping: int,
    name: str, spared: int = 0,
) -> str:  # fmt: skip
    """Return a PDO that these objects can be mapped into, as the rig's file has it.

    It is the first one but for those `spared`.
    """
    for number in range(1, PDOS + 1):
        cob = dictionary.get_variable(communication + number - 1, 1)
        count = dictionary.get_variable(mapping + number - 1, 0)
        if cob is None or count is None or not count.writable or cob.default is None:
            continue
        if spared:
            spared -= 1
            continue
        listed = ", ".join(f'"{entry}"' for entry in objects)
        return f"{{number: {number}, transmission_type: 1, objects: [{listed}]}}"
    what = "RPDO" if mapping == RPDO_MAPPING else "TPDO"
    raise AxisError(
        f"{name}: no {what} has a mapping that can be written and a default COB-ID"
        ": write the PDO into the rig by hand"
    )


def _setup(dictionary: ObjectDictionary, wanted: dict[str, int]) -> tuple[str, list[str]]:
    """Return the preset's setup as far as the drive has its entries, within their limits."""
    kept, notes = [], []
    for entry, value in wanted.items():
        found = _variable(dictionary, entry)
        if found is None:
            notes.append(f"setup: {entry} is left out: this drive has no such entry")
            continue
        most = value if found.max is None else found.max
        if value > most:
            notes.append(f"setup: {entry} is its largest, {most}; the preset has {value}")
        kept.append(f'"{entry}": {min(value, most)}')
    return ", ".join(kept), notes


def _input(dictionary: ObjectDictionary, usual: str, name: str) -> tuple[str, str]:
    """Return the entry of an analog input and a note: the usual one, or the first by its name.

    Raises AxisError where none can be sent in a PDO.
    """
    found = {
        f"0x{one.index:04X}:{one.subindex}" if one.subindex else f"0x{one.index:04X}": one
        for one in _variables(dictionary)
        if one.pdo_mappable and one.readable and one.data_type in FORMATS
    }
    named = [entry for entry, one in found.items() if ANALOG.search(_full_name(dictionary, one))]
    entries = [usual] if usual in found else named
    if not entries:
        raise AxisError(
            f"{name}: no object with an analog input in its name can be mapped into a PDO: take"
            " another sensor, or put the input's object into the EDS"
        )
    others = ", ".join(entry for entry in named if entry != entries[0])
    note = f"{entries[0]} ({_full_name(dictionary, found[entries[0]])}) is taken for the force"
    note = f"{note}; others are {others}" if others else note
    return entries[0], f"{note}: set its scale, lowest and highest, by `calibrate force` and manual"


def _variables(dictionary: ObjectDictionary) -> Iterator[ODVariable]:
    """Return every entry, those within arrays and records one by one."""
    for one in dictionary.values():
        yield from (one,) if isinstance(one, ODVariable) else one.values()


def _full_name(dictionary: ObjectDictionary, one: ODVariable) -> str:
    """Return the name of an entry after that of its object."""
    of = dictionary[one.index].name
    return one.name if of == one.name else f"{of}: {one.name}"


def _numbers(dictionary: ObjectDictionary) -> list[str]:
    """Return speed and torque of the EDS, to be compared with the rig's."""
    notes = []
    for entry, words in (
        ("0x607F", "largest speed, in units of which speed_count is one"),
        ("0x6076", "rated torque in mNm: rated_force is the force at it"),
    ):
        found = _variable(dictionary, entry)
        if found is not None and found.default:
            notes.append(f"{entry} ({words}) is {found.default} as delivered")
    unit = _variable(dictionary, SPEED_UNIT)
    if unit is not None:
        said = f"{unit.default:#010x}" if unit.default else "not stated"
        notes.append(
            f"{SPEED_UNIT} (unit of speeds) is {said}: where it is not counts/s, set speed_count"
        )
    return notes
