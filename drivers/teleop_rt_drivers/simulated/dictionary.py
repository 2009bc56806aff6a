"""The object dictionary of a simulated device: values, access rules, PDO mappings."""

from __future__ import annotations

import configparser
import struct
from importlib import resources
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.eds import import_eds
from canopen.sdo.exceptions import SdoAbortedError

from teleop_rt.axis import AxisError

if TYPE_CHECKING:
    from collections.abc import Callable

    Raw = int | float | str | bytes | bytearray
    Live = dict[tuple[int, int], Callable[[], float]]

TPDOS = range(0x1800, 0x1A00)
RPDOS = range(0x1400, 0x1600)
MAPPINGS = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))
MAPPING_OFFSET = 0x200
"""From a PDO's communication record to its mapping (CiA 301)."""
INVALID = 1 << 31  # bit of a COB-ID: the PDO is switched off (CiA 301)
SYNCHRONOUS = range(1, 241)
EVENT_DRIVEN = (254, 255)  # transmission types that wait for no SYNC (CiA 301)
# SDO abort codes (CiA 301, table 22).
WRITE_ONLY, READ_ONLY, WRONG_LENGTH = 0x06010001, 0x06010002, 0x06070010
NOT_IN_DICTIONARY, NO_DATA, NO_ACCESS_NOW = 0x06020000, 0x060A0023, 0x08000022
NOT_MAPPABLE, MAPPING_TOO_LONG = 0x06040041, 0x06040042


def dictionary_of(eds: str, node_id: int) -> ObjectDictionary:
    """Read the device's own EDS, a path or a file of this package. Raises AxisError."""
    path = Path(eds)
    source = path if path.is_file() else resources.files("teleop_rt_drivers") / "eds" / eds
    try:
        text = source.read_text()
    except OSError as error:
        message = f"EDS {eds}: {error.strerror}; name a file, or one of this package's eds folder"
        raise AxisError(message) from None
    try:
        found: ObjectDictionary = import_eds(StringIO(text), node_id)  # type: ignore[no-untyped-call]
    except (configparser.Error, ValueError, LookupError) as error:
        raise AxisError(f"EDS {eds}: cannot be read: {error}; `check` says where") from error
    return found


def _defaults(dictionary: ObjectDictionary) -> dict[tuple[int, int], int]:
    """Return the power-on values of all entries that are whole numbers."""
    defaults = {}
    for entry in dictionary.values():
        members = [entry] if isinstance(entry, ODVariable) else list(entry.values())
        for member in members:
            if isinstance(member.default, int):
                defaults[member.index, member.subindex] = member.default
    return defaults


class Pdo:
    """One enabled PDO, compiled from the dictionary when it was configured."""

    def __init__(self, cob_id: int, every: int, variables: list[ODVariable], timer_ns: int) -> None:
        self.cob_id = cob_id
        self.timer_ns = timer_ns
        self.every = every
        self.keys = [(variable.index, variable.subindex) for variable in variables]
        self.formats = "".join(
            ODVariable.STRUCT_TYPES[variable.data_type or 0].format[-1] for variable in variables
        )
        self.struct = struct.Struct("<" + self.formats)
        self.readers: list[Callable[[], float]] = []


class ObjectStore:
    """The entries of an EDS: `live` ones are read from the physics, the others are stored.

    SDO server and PDOs both come here; refusals are SdoAbortedError, with CiA 301's codes.
    """

    def __init__(self, eds: str, node_id: int, live: Live) -> None:
        self.object_dictionary = dictionary_of(eds, node_id)
        self._live = live
        self._defaults = _defaults(self.object_dictionary)
        self._stored: dict[tuple[int, int], Raw] = {}
        self.tpdos: list[Pdo] = []
        self._events: list[Pdo] = []
        self.deadline_ns = 0
        self.rpdos: dict[int, Pdo] = {}

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return the bytes of an entry; raises SdoAbortedError."""
        entry = self._entry(index, subindex)
        if check_readable and not entry.readable:
            raise SdoAbortedError(WRITE_ONLY)
        if (reader := self._live.get((index, subindex))) is not None:
            return entry.encode_raw(reader())
        raw = self._stored.get((index, subindex), entry.default)
        if raw is None:
            raise SdoAbortedError(NO_DATA)
        return entry.encode_raw(raw)

    def set_data(
        self,
        index: int,
        subindex: int,
        data: bytes,
        check_writable: bool = False,
    ) -> None:
        """Store the bytes of an entry; raises SdoAbortedError."""
        entry = self._entry(index, subindex)
        if check_writable and not entry.writable:
            raise SdoAbortedError(READ_ONLY)
        if entry.fixed_size and 8 * len(data) != len(entry):
            raise SdoAbortedError(WRONG_LENGTH)
        self._check_mapping(index, subindex, data)
        self._stored[index, subindex] = entry.decode_raw(bytes(data))
        if index in TPDOS or index in RPDOS:
            self._compile_pdos()
        self.written(index)

    def value(self, index: int, subindex: int = 0) -> int:
        """Return a whole number that is stored, or its default."""
        key = (index, subindex)
        raw = self._stored.get(key)
        return int(self._defaults[key] if raw is None else raw)

    def written(self, index: int) -> None:
        """React to a write by SDO or RPDO; the base device has nothing to do."""

    def _entry(self, index: int, subindex: int) -> ODVariable:
        entry = self.object_dictionary.get_variable(index, subindex)
        if entry is None:
            raise SdoAbortedError(NOT_IN_DICTIONARY)
        return entry

    def _check_mapping(self, index: int, subindex: int, data: bytes) -> None:
        """Refuse as a device does: a mapping changed in use, not mappable, or too long."""
        if not any(index in block for block in MAPPINGS):
            return
        enabled = not self.value(index - MAPPING_OFFSET, 1) & INVALID
        if enabled or (subindex and self.value(index, 0)):
            raise SdoAbortedError(NO_ACCESS_NOW)
        if subindex:
            word = int.from_bytes(data, "little")
            if not self._entry(word >> 16, word >> 8 & 0xFF).pdo_mappable:
                raise SdoAbortedError(NOT_MAPPABLE)
        else:
            bits = sum(self.value(index, sub) & 0xFF for sub in range(1, data[0] + 1))
            if bits > 64:
                raise SdoAbortedError(MAPPING_TOO_LONG)

    def _compile_pdos(self) -> None:
        """Compile the enabled PDOs, so that a SYNC costs no look-ups."""
        self.tpdos = []
        self._events = []
        self.rpdos = {}
        timers_ns = [self._timer_ns(index) for index in self.object_dictionary if index in RPDOS]
        self.deadline_ns = max(timers_ns, default=0)
        for index in self.object_dictionary:
            if index in TPDOS and (pdo := self._compiled(index)) is not None:
                pdo.readers = [self._reader(key) for key in pdo.keys]
                (self.tpdos if pdo.every in SYNCHRONOUS else self._events).append(pdo)
            elif index in RPDOS and (pdo := self._compiled(index)) is not None:
                self.rpdos[pdo.cob_id] = pdo

    def _compiled(self, index: int) -> Pdo | None:
        cob_id, every = self.value(index, 1), self.value(index, 2)
        timer_ns = self._timer_ns(index)
        event = every in EVENT_DRIVEN and (index in RPDOS or timer_ns > 0)
        if cob_id & INVALID or not (every in SYNCHRONOUS or event):
            return None
        mapping = index + MAPPING_OFFSET
        words = [self.value(mapping, sub) for sub in range(1, self.value(mapping, 0) + 1)]
        variables = [self._entry(word >> 16, word >> 8 & 0xFF) for word in words]
        return Pdo(cob_id & 0x7FF, every, variables, timer_ns)

    def _timer_ns(self, index: int) -> int:
        """Return a PDO's event timer (sub-index 5), 0 without one."""
        return self.value(index, 5) * 1_000_000 if (index, 5) in self._defaults else 0

    def _reader(self, key: tuple[int, int]) -> Callable[[], float]:
        return self._live.get(key) or (lambda: self.value(*key))
