"""Process data objects as precompiled structs: bytes to values and back, no dictionary look-ups."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.canopen.eds import cob_id, variable
from teleop_rt_drivers.canopen.entries import Entry, address
from teleop_rt_drivers.canopen.node_config import PdoConfig

if TYPE_CHECKING:
    from canopen.objectdictionary import ObjectDictionary

FORMATS = {
    0x02: "b",
    0x03: "h",
    0x04: "i",
    0x05: "B",
    0x06: "H",
    0x07: "I",
    0x08: "f",
    0x11: "d",
    0x15: "q",
    0x1B: "Q",
}
"""Format of each CiA 301 data type that fills whole bytes."""

# Index of the first PDO's parameters (CiA 301).
TPDO_COMMUNICATION, TPDO_MAPPING = 0x1800, 0x1A00
RPDO_COMMUNICATION, RPDO_MAPPING = 0x1400, 0x1600
BYTES_PER_FRAME = 8  # of classical CAN, which CiA 301 uses


class PdoCodec:
    """The layout of one PDO, built from the config's objects and the EDS's types.

    `words` are the mapping entries as object 1A00h or 1600h holds them (index, sub-index, bits),
    `kinds` the struct formats of the entries and `places` their first bytes.
    """

    def __init__(
        self, pdo: PdoConfig, dictionary: ObjectDictionary, name: str, *, receive: bool
    ) -> None:
        self.name = name
        self.communication = RPDO_COMMUNICATION if receive else TPDO_COMMUNICATION
        self.mapping = RPDO_MAPPING if receive else TPDO_MAPPING
        self.communication += pdo.number - 1
        self.mapping += pdo.number - 1
        self.transmission_type = pdo.transmission_type
        self._addresses = [address(entry) for entry in pdo.objects]
        self._name = f"{name}, {'R' if receive else 'T'}PDO{pdo.number}"
        layout = "<"
        self.words: list[int] = []
        for entry, (index, subindex) in zip(pdo.objects, self._addresses, strict=True):
            layout += self._format(dictionary, entry)
            bits = 8 * struct.calcsize("<" + layout[-1])
            self.words.append(index << 16 | subindex << 8 | bits)
        self.struct = struct.Struct(layout)
        self.kinds = layout[1:]
        self.places = [struct.calcsize(layout[: 1 + slot]) for slot in range(len(self.kinds))]
        if self.struct.size > BYTES_PER_FRAME:
            raise AxisError(
                f"{self._name}: {self.struct.size} bytes are mapped, a frame holds 8"
                ": list fewer `objects`"
            )
        try:
            self.cob_id = cob_id(
                dictionary, pdo, RPDO_COMMUNICATION if receive else TPDO_COMMUNICATION
            )
        except KeyError as error:
            raise AxisError(f"{self._name}: the EDS lacks {error}; set cob_id") from error

    def _format(self, dictionary: ObjectDictionary, entry: Entry) -> str:
        """Return the struct format of an entry; refuses one that cannot be mapped."""
        try:
            found = variable(dictionary, *address(entry))
        except KeyError:
            raise AxisError(
                f"{self._name}: the EDS has no object {entry}"
                ": remove it from `objects`, or name the right EDS"
            ) from None
        if not found.pdo_mappable:
            raise AxisError(
                f"{self._name}: the EDS says that {entry} cannot be mapped"
                ": remove it from `objects`"
            )
        if found.data_type not in FORMATS:
            raise AxisError(
                f"{self._name}: {entry} has a type that does not fill whole bytes"
                ": remove it from `objects`"
            )
        return FORMATS[found.data_type]

    def slot(self, entry: Entry) -> int:
        """Return the place of an entry among the unpacked values; raises AxisError."""
        try:
            return self._addresses.index(address(entry))
        except ValueError:
            raise AxisError(f"{self._name} does not carry {entry}: add it to `objects`") from None
