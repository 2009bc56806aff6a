"""A CANopen slave in bytes: NMT, heartbeat, SDO server, SYNC-triggered PDOs, emergencies.

It is written from CiA 301 and shares nothing with the axis but the EDS files.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from typing import TYPE_CHECKING

from canopen.sdo.server import SdoServer

from teleop_rt_drivers.simulated.dictionary import EVENT_DRIVEN, ObjectStore
from teleop_rt_drivers.simulated.senses import signed

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.simulated.dictionary import Live, Pdo, Raw

    Send = Callable[[int, bytes], None]
    Measured = tuple[int, float, float]


class Nmt(IntEnum):
    """NMT states as encoded in heartbeats."""

    INITIALISING = 0
    STOPPED = 4
    OPERATIONAL = 5
    PRE_OPERATIONAL = 127


STORE, RESTORE = 0x1010, 0x1011  # objects that save and restore parameters (CiA 301)
LONGEST_QUIET_NS = 1_000_000_000
"""So long at most no timer of a device is looked at."""
SAVE, LOAD = 0x65766173, 0x64616F6C
"""The signatures for 1010h and 1011h: "save" and "load"."""


class _Server(SdoServer):
    """The canopen package's SDO server, answering through the device's own sender."""

    def __init__(self, device: Node, send: Send) -> None:
        super().__init__(0x600 + device.node_id, 0x580 + device.node_id, device)  # type: ignore[no-untyped-call]
        self._index = self._subindex = 0
        self._send = send

    def send_response(self, response: bytes) -> None:
        """Send an answer."""
        self._send(self.tx_cobid, bytes(response))


class Node(ObjectStore):
    """A node of the simulated network.

    Derived devices add `commanded` (at SYNC, when RPDO values are stored), `left_operational`
    and `lost_consumer`. `measured` says which objects change by themselves, as the kernel
    `answer.measured` takes them, or None for those that it does not know. `changed` is set where
    something beside process data has come about; `Answering` looks at it, and takes it back.
    """

    def __init__(self, name: str, node_id: int, eds: str, send: Send, live: Live) -> None:
        super().__init__(eds, node_id, live)
        self.name = name
        self.node_id = node_id
        self.state = Nmt.INITIALISING
        self.measured: dict[tuple[int, int], Measured | None] = {}
        self.changed = True
        self._send = send
        self._server = _Server(self, send)
        self.received: list[tuple[Pdo, bytes]] = []
        self._syncs = 0
        self._heartbeat_due_ns = 0
        self._heartbeat_period_ns = 0
        self._lends_heartbeat = False
        self._heard_ns = self._guarded_ns = 0
        self._watched_node = 0
        self._watch_timeout_ns = 0
        self._toggle = 0
        self._life_ns = 0
        self.quiet_until_ns = 0
        self._commanded_ns = 0
        self._event_due_ns: dict[int, int] = {}
        self._saved: dict[tuple[int, int], Raw] = {}

    def written(self, index: int) -> None:
        """Take new heartbeat times over; store or restore written entries (1010h, 1011h)."""
        if index == STORE and self.value(STORE, 1) == SAVE:
            self._saved = {k: v for k, v in self._stored.items() if k[0] not in (STORE, RESTORE)}
        elif index == RESTORE and self.value(RESTORE, 1) == LOAD:
            self._saved = {}
        if index in (0x1016, 0x1017, 0x100C, 0x100D):
            self._compile_watch()
        self.quiet_until_ns = 0
        self.changed = True

    def receive_pdo(self, cob_id: int, data: bytes) -> None:
        """Keep a synchronous RPDO for the next SYNC; act on one of type 254 or 255 at once.

        A short one is an emergency (8210h), of a long one (8220h) the first bytes are used.
        """
        pdo = self.rpdos.get(cob_id)
        if pdo is None or self.state is not Nmt.OPERATIONAL:
            return
        if len(data) < pdo.struct.size:
            self.emergency(0x8210)
            return
        if len(data) > pdo.struct.size:
            self.emergency(0x8220)
        self._commanded_ns = -1
        self.changed = True
        self.received.append((pdo, data[: pdo.struct.size]))
        if pdo.every in EVENT_DRIVEN:
            self._take_commands()

    def _take_commands(self) -> None:
        """Store received entries, and act on them."""
        self.changed = True
        for pdo, data in self.received:
            self._stored.update(zip(pdo.keys, pdo.struct.unpack(data), strict=True))
        self.received.clear()
        self.commanded()

    def sync(self) -> None:
        """Act on the RPDOs received, then send the TPDOs that this SYNC triggers."""
        if self.state is not Nmt.OPERATIONAL:
            return
        if self.received:
            self._take_commands()
        self._syncs += 1
        for pdo in self.tpdos:
            if self._syncs % pdo.every == 0:
                self._send(pdo.cob_id, pdo.struct.pack(*[read() for read in pdo.readers]))

    # Done by a kernel instead (`answering.py`).

    @property
    def is_usual(self) -> bool:
        """Return whether each SYNC triggers all that it sends, and a kernel knows it all."""
        if self.state is not Nmt.OPERATIONAL or self._events or self.deadline_ns:
            return False
        return all(
            pdo.every == 1 and all(self.measured.get(key, ()) is not None for key in pdo.keys)
            for pdo in self.tpdos
        )

    def objects(self) -> list[tuple[Pdo, int, list[tuple[int, int, Measured]]]]:
        """Return each TPDO, its bytes as a number without measured values, and those values.

        Each measured object comes with its lowest bit and the mask of its bits there.
        """
        return [(pdo, *self._parts(pdo)) for pdo in self.tpdos]

    def _parts(self, pdo: Pdo) -> tuple[int, list[tuple[int, int, Measured]]]:
        number, at = 0, 0
        measured = []
        for key, form, read in zip(pdo.keys, pdo.formats, pdo.readers, strict=True):
            bits = 8 * struct.calcsize(f"<{form}")
            if (found := self.measured.get(key)) is None:
                number |= int.from_bytes(struct.pack(f"<{form}", read()), "little") << at
            else:
                measured.append((at, (1 << bits) - 1, found))
            at += bits
        return signed(number, 64), measured

    def lend_heartbeat(self) -> tuple[int, int, int]:
        """Let a kernel send the heartbeats; return when one is due, their period, and the state.

        The period [ns] is 0 where there are none.
        """
        self._lends_heartbeat, self.quiet_until_ns = True, 0
        return self._heartbeat_due_ns, self._heartbeat_period_ns, self.state

    def take_heartbeat(self, due_ns: int) -> None:
        """Send the heartbeats again, the next one then, unless it has booted meanwhile."""
        if self._lends_heartbeat:
            self._lends_heartbeat, self._heartbeat_due_ns, self.quiet_until_ns = False, due_ns, 0

    def skip(self, syncs: int) -> None:
        """Count the SYNCs that were answered in its place."""
        self._syncs += syncs

    def commanded(self) -> None:
        """Act on commands that have just been stored; the base device has none."""

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
        self.changed = True
        self._enter(Nmt.INITIALISING)
        kept = {} if whole else {k: v for k, v in self._stored.items() if k[0] >= 0x2000}
        self._stored = self._saved | kept
        self._event_due_ns.clear()
        self._commanded_ns = 0
        self.received.clear()
        self._heard_ns = self._guarded_ns = 0
        self._toggle = 0
        self._heartbeat_due_ns, self._lends_heartbeat = 0, False
        self._compile_pdos()
        self._compile_watch()
        self._send(0x700 + self.node_id, b"\0")
        self._enter(Nmt.PRE_OPERATIONAL)

    def _enter(self, state: Nmt) -> None:
        previous, self.state = self.state, state
        self.changed = True
        if previous is Nmt.OPERATIONAL and state is not Nmt.OPERATIONAL:
            self.received.clear()
            self.left_operational()

    def left_operational(self) -> None:
        """React to the end of process data; the base device has nothing to do."""

    def _compile_watch(self) -> None:
        """Take over the heartbeat times of the dictionary."""
        self.quiet_until_ns = 0
        heartbeat_ms = self.value(0x1017) if 0x1017 in self.object_dictionary else 0
        self._heartbeat_period_ns = heartbeat_ms * 1_000_000
        guarded = 0x100C in self.object_dictionary
        life_ms = self.value(0x100C) * self.value(0x100D) if guarded else 0
        self._life_ns = life_ms * 1_000_000
        watch = self.value(0x1016, 1)
        self._watched_node = watch >> 16 & 0x7F
        self._watch_timeout_ns = (watch & 0xFFFF) * 1_000_000

    def receive_guard(self, now_ns: int) -> None:
        """Answer the master's remote frame with state and toggle bit; its life is watched, too."""
        if self.state is Nmt.INITIALISING or self._heartbeat_period_ns:
            return
        self._send(0x700 + self.node_id, bytes((self._toggle << 7 | self.state,)))
        self._toggle ^= 1
        self._guarded_ns, self.quiet_until_ns = now_ns, 0

    def receive_heartbeat(self, node_id: int, now_ns: int) -> None:
        """Note a heartbeat of the node that is watched (1016h); the watch starts with it."""
        if node_id == self._watched_node:
            self._heard_ns, self.quiet_until_ns = now_ns, 0

    def run_timers(self, now_ns: int) -> None:
        """Send the heartbeat when it is due, and find the watched node's silence."""
        if self._beats and now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + self._heartbeat_period_ns
            self._send(0x700 + self.node_id, bytes((self.state,)))
        if (self._events or self.deadline_ns) and self.state is Nmt.OPERATIONAL:
            self._send_events(now_ns)
            self._watch_commands(now_ns)
        if self._life_ns and self._guarded_ns and now_ns - self._guarded_ns > self._life_ns:
            self._guarded_ns = 0
            self.emergency(0x8130)
            self.lost_consumer()
        watching = self._watch_timeout_ns and self._heard_ns
        if watching and now_ns - self._heard_ns > self._watch_timeout_ns:
            self._heard_ns = 0
            self.emergency(0x8130)
            self.lost_consumer()
        self.quiet_until_ns = self._next_timer_ns(now_ns)

    @property
    def _beats(self) -> bool:
        """Return whether it sends heartbeats itself."""
        return self._heartbeat_period_ns > 0 and not self._lends_heartbeat

    def _next_timer_ns(self, now_ns: int) -> int:
        """Return the time before which no timer ends, as things are now."""
        if self._events or self.deadline_ns:
            return now_ns
        due_ns = [now_ns + LONGEST_QUIET_NS]
        if self._beats:
            due_ns.append(self._heartbeat_due_ns)
        if self._life_ns and self._guarded_ns:
            due_ns.append(self._guarded_ns + self._life_ns)
        if self._watch_timeout_ns and self._heard_ns:
            due_ns.append(self._heard_ns + self._watch_timeout_ns)
        return min(due_ns)

    def _send_events(self, now_ns: int) -> None:
        """Send the TPDOs of type 254 and 255 that have an event timer, when it ends."""
        for pdo in self._events:
            if now_ns >= self._event_due_ns.get(pdo.cob_id, 0):
                self._event_due_ns[pdo.cob_id] = now_ns + pdo.timer_ns
                self._send(pdo.cob_id, pdo.struct.pack(*[read() for read in pdo.readers]))

    def _watch_commands(self, now_ns: int) -> None:
        """Send an emergency (8250h) if no RPDO came for its event timer (1400h:5)."""
        if self._commanded_ns < 0:
            self._commanded_ns = now_ns
        timeout_ns = self.deadline_ns
        if timeout_ns and self._commanded_ns and now_ns - self._commanded_ns > timeout_ns:
            self._commanded_ns = 0
            self.emergency(0x8250)

    def lost_consumer(self) -> None:
        """React to the watched node's silence as 1029h:1 says."""
        behaviour = self.value(0x1029, 1)
        if behaviour == 0 and self.state is Nmt.OPERATIONAL:
            self._enter(Nmt.PRE_OPERATIONAL)
        elif behaviour == 2:
            self._enter(Nmt.STOPPED)

    def emergency(self, code: int, register: int = 0x11) -> None:
        """Send an emergency message and keep it in the error field (1003h)."""
        self.changed = True
        count = min(self.value(0x1003, 0) + 1, 8)
        for subindex in range(count, 1, -1):
            self._stored[0x1003, subindex] = self.value(0x1003, subindex - 1)
        self._stored[0x1003, 1] = code
        self._stored[0x1003, 0] = count
        self._send(0x080 + self.node_id, struct.pack("<HB5x", code, register))
