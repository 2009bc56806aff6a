"""A CANopen slave in bytes: NMT, heartbeat, SDO server, SYNC-triggered PDOs, emergencies.

It is written from CiA 301 and shares nothing with the axis but the EDS files.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from importlib import resources
from io import StringIO
from pathlib import Path
from typing import TYPE_CHECKING

from canopen.objectdictionary import ObjectDictionary, ODVariable
from canopen.objectdictionary.eds import import_eds
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

if TYPE_CHECKING:
    from collections.abc import Callable

    Send = Callable[[int, bytes], None]
    Raw = int | float | str | bytes | bytearray
    Live = dict[tuple[int, int], Callable[[], float]]

TPDOS = range(0x1800, 0x1A00)
RPDOS = range(0x1400, 0x1600)
MAPPINGS = (range(0x1600, 0x1800), range(0x1A00, 0x1C00))
MAPPING_OFFSET = 0x200
INVALID = 1 << 31
SYNCHRONOUS = range(1, 241)
WRITE_ONLY, READ_ONLY, WRONG_LENGTH = 0x06010001, 0x06010002, 0x06070010
NOT_IN_DICTIONARY, NO_DATA, NO_ACCESS_NOW = 0x06020000, 0x060A0023, 0x08000022
NOT_MAPPABLE, MAPPING_TOO_LONG = 0x06040041, 0x06040042
"""SDO abort codes (CiA 301, table 22)."""


class Nmt(IntEnum):
    """NMT states as heartbeats tell them."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


def dictionary_of(eds: str, node_id: int) -> ObjectDictionary:
    """Read the device's own EDS, a path or a file of this package."""
    path = Path(eds)
    source = path if path.is_file() else resources.files("teleop_rt_drivers") / "eds" / eds
    found: ObjectDictionary = import_eds(StringIO(source.read_text()), node_id)  # type: ignore[no-untyped-call]
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


class _Server(SdoServer):
    """The canopen package's SDO server, answering through the device's own sender."""

    def __init__(self, device: Device, send: Send) -> None:
        super().__init__(0x600 + device.node_id, 0x580 + device.node_id, device)  # type: ignore[no-untyped-call]
        self._index = self._subindex = 0
        self._send = send

    def send_response(self, response: bytes) -> None:
        """Send an answer."""
        self._send(self.tx_cobid, bytes(response))


class Pdo:
    """One enabled PDO, compiled from the dictionary when it was configured."""

    def __init__(self, cob_id: int, every: int, variables: list[ODVariable]) -> None:
        self.cob_id = cob_id
        self.every = every
        self.keys = [(variable.index, variable.subindex) for variable in variables]
        formats = "".join(
            ODVariable.STRUCT_TYPES[variable.data_type or 0].format[-1] for variable in variables
        )
        self.struct = struct.Struct("<" + formats)
        self.readers: list[Callable[[], float]] = []


class Device:
    """A node of the simulated network.

    `live` gives the current value of entries that the physics decide; the others are stored as
    SDO or RPDO wrote them. Derived devices add `latched` (at SYNC, before TPDOs are sent),
    `commanded` (at SYNC, RPDO values are stored) and `lost_consumer`.
    """

    def __init__(self, name: str, node_id: int, eds: str, send: Send, live: Live) -> None:
        self.name = name
        self.node_id = node_id
        self.object_dictionary = dictionary_of(eds, node_id)
        self.state = Nmt.INITIALISING
        self._send = send
        self._live = live
        self._defaults = _defaults(self.object_dictionary)
        self._stored: dict[tuple[int, int], Raw] = {}
        self._server = _Server(self, send)
        self._tpdos: list[Pdo] = []
        self._rpdos: dict[int, Pdo] = {}
        self._received: list[tuple[Pdo, bytes]] = []
        self._syncs = 0
        self._heartbeat_due_ns = 0
        self._heartbeat_period_ns = 0
        self._heard_ns = 0
        self._watched_node = 0
        self._watch_timeout_ns = 0

    # Object dictionary: what the SDO server and the PDOs see.

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
        self.written(index)
        if index in TPDOS or index in RPDOS:
            self._compile_pdos()
        elif index in (0x1016, 0x1017):
            self._compile_watch()

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
        """Refuse what a device refuses: a mapping changed in use, not mappable, or too long."""
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

    # Process data.

    def _compile_pdos(self) -> None:
        """Compile the enabled PDOs, so that a SYNC costs no look-ups."""
        self._tpdos = []
        self._rpdos = {}
        for index in self.object_dictionary:
            if index in TPDOS and (pdo := self._compiled(index)) is not None:
                pdo.readers = [self._reader(key) for key in pdo.keys]
                self._tpdos.append(pdo)
            elif index in RPDOS and (pdo := self._compiled(index)) is not None:
                self._rpdos[pdo.cob_id] = pdo

    def _compiled(self, index: int) -> Pdo | None:
        cob_id, every = self.value(index, 1), self.value(index, 2)
        if cob_id & INVALID or every not in SYNCHRONOUS:
            return None
        mapping = index + MAPPING_OFFSET
        words = [self.value(mapping, sub) for sub in range(1, self.value(mapping, 0) + 1)]
        variables = [self._entry(word >> 16, word >> 8 & 0xFF) for word in words]
        return Pdo(cob_id & 0x7FF, every, variables)

    def _reader(self, key: tuple[int, int]) -> Callable[[], float]:
        return self._live.get(key) or (lambda: self.value(*key))

    def receive_pdo(self, cob_id: int, data: bytes) -> None:
        """Keep a synchronous RPDO for the next SYNC; a short one is an emergency (8210h)."""
        pdo = self._rpdos.get(cob_id)
        if pdo is None or self.state is not Nmt.OPERATIONAL:
            return
        if len(data) < pdo.struct.size:
            self.emergency(0x8210)
            return
        self._received.append((pdo, data[: pdo.struct.size]))

    def sync(self) -> None:
        """Act on the RPDOs received, then send the TPDOs that this SYNC triggers."""
        if self.state is not Nmt.OPERATIONAL:
            return
        for pdo, data in self._received:
            self._stored.update(zip(pdo.keys, pdo.struct.unpack(data), strict=True))
        self.commanded(new=bool(self._received))
        self._received.clear()
        self._syncs += 1
        for pdo in self._tpdos:
            if self._syncs % pdo.every == 0:
                self._send(pdo.cob_id, pdo.struct.pack(*[read() for read in pdo.readers]))

    def commanded(self, *, new: bool) -> None:
        """Act on the stored commands at a SYNC; the base device has none."""

    # Network management.

    def receive_sdo(self, data: bytes) -> None:
        """Answer an SDO request; a stopped node does not."""
        if self.state is not Nmt.STOPPED and len(data) == 8:
            self._server.on_request(self._server.rx_cobid, data, 0.0)  # type: ignore[no-untyped-call]

    def receive_nmt(self, command: int) -> None:
        """Obey an NMT command (CiA 301, 7.3.2.2)."""
        if command == 0x01:
            self._enter(Nmt.OPERATIONAL)
        elif command == 0x02:
            self._enter(Nmt.STOPPED)
        elif command == 0x80:
            self._enter(Nmt.PRE_OPERATIONAL)
        elif command in (0x81, 0x82):
            self.boot(whole=command == 0x81)

    def boot(self, *, whole: bool = True) -> None:
        """Start with power-on values, all or those of communication only, and say so."""
        self._enter(Nmt.INITIALISING)
        kept = {} if whole else {k: v for k, v in self._stored.items() if k[0] >= 0x2000}
        self._stored = kept
        self._received.clear()
        self._heard_ns = 0
        self._heartbeat_due_ns = 0
        self._compile_pdos()
        self._compile_watch()
        self._send(0x700 + self.node_id, b"\0")
        self._enter(Nmt.PRE_OPERATIONAL)

    def _enter(self, state: Nmt) -> None:
        previous, self.state = self.state, state
        if previous is Nmt.OPERATIONAL and state is not Nmt.OPERATIONAL:
            self._received.clear()
            self.left_operational()

    def left_operational(self) -> None:
        """React to the end of process data; the base device has nothing to do."""

    def _compile_watch(self) -> None:
        """Take over the heartbeat times of the dictionary."""
        self._heartbeat_period_ns = self.value(0x1017) * 1_000_000
        watch = self.value(0x1016, 1)
        self._watched_node = watch >> 16 & 0x7F
        self._watch_timeout_ns = (watch & 0xFFFF) * 1_000_000

    def receive_heartbeat(self, node_id: int, now_ns: int) -> None:
        """Note a heartbeat of the node that is watched (1016h); the watch starts with it."""
        if node_id == self._watched_node:
            self._heard_ns = now_ns

    def run_timers(self, now_ns: int) -> None:
        """Send the heartbeat when it is due, and find the watched node's silence."""
        if self._heartbeat_period_ns and now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + self._heartbeat_period_ns
            self._send(0x700 + self.node_id, bytes((self.state,)))
        watching = self._watch_timeout_ns and self._heard_ns
        if watching and now_ns - self._heard_ns > self._watch_timeout_ns:
            self._heard_ns = 0
            self.emergency(0x8130)
            self.lost_consumer()

    def lost_consumer(self) -> None:
        """React to the watched node's silence as 1029h:1 says."""
        behaviour = self.value(0x1029, 1)
        if behaviour == 0 and self.state is Nmt.OPERATIONAL:
            self._enter(Nmt.PRE_OPERATIONAL)
        elif behaviour == 2:
            self._enter(Nmt.STOPPED)

    def emergency(self, code: int, register: int = 0x11) -> None:
        """Send an emergency message and keep it in the error field (1003h)."""
        count = min(self.value(0x1003, 0) + 1, 8)
        for subindex in range(count, 1, -1):
            self._stored[0x1003, subindex] = self.value(0x1003, subindex - 1)
        self._stored[0x1003, 1] = code
        self._stored[0x1003, 0] = count
        self._send(0x080 + self.node_id, struct.pack("<HB5x", code, register))
