"""Decoding of a CANopen axis's frames: values, heartbeats, emergencies, faults."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from teleop_rt.axis import NO_AXIS_FAULT, AxisFault, Sample
from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.can_door import NOT_LENT, UNUSUAL
from teleop_rt_drivers.can_frames import (
    ERROR,
    EXTENDED_MASK,
    MOST_FRAMES_PER_CYCLE,
    REMOTE,
    UNREADABLE,
    SlotReader,
)
from teleop_rt_drivers.canopen import eds, intake, setup
from teleop_rt_drivers.canopen.emergency import emergency_in_words
from teleop_rt_drivers.canopen.exchange import SENT, UNSENT, exchange
from teleop_rt_drivers.canopen.intake import (
    CHANGED,
    DUPLICATE,
    LOST,
)
from teleop_rt_drivers.canopen.pdo import PdoCodec
from teleop_rt_drivers.canopen.sdo import BOOT_UP
from teleop_rt_drivers.canopen.source import NOBODY, NOWHERE, new_reading, side_by_side
from teleop_rt_drivers.canopen.watch import HeartbeatConsumer, NodeGuards, error_frame_fault
from teleop_rt_drivers.drivetrain import Drivetrain

if TYPE_CHECKING:
    from collections.abc import Callable

    import can

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.canopen.build import Parts
    from teleop_rt_drivers.canopen.config import CanopenPart
    from teleop_rt_drivers.canopen.counters import Counters
    from teleop_rt_drivers.canopen.exchange import Syncs
    from teleop_rt_drivers.canopen.source import Reading, Readings

    Data = bytes | bytearray
    Handler = Callable[[int, Data, int], object]
    """Takes the id, the bytes and the time of the cycle."""

# COB-ID of an emergency without the node's id, and its length; range of SDOs' ids (CiA 301).
EMERGENCY, EMERGENCY_BYTES = 0x080, 8
SDO = (0x580, 0x680)


def sent_by_daemon(config: CanopenPart) -> Callable[[int], bool]:
    """Return a test for the daemon's own frames in a log: NMT, SYNC, heartbeat, commands, SDO."""
    daemon = config.daemon
    ids = {setup.NMT, daemon.sync_cob_id, BOOT_UP + daemon.node_id}
    if (drive := config.drive) is not None:
        dictionary = eds.load(drive.eds, drive.node_id)
        ids.add(PdoCodec(drive.rpdo, dictionary, "drive", receive=True).cob_id)
    return lambda cob_id: cob_id in ids or SDO[0] <= cob_id < SDO[1]


def _without_door(*_: object) -> int:
    """Return as `exchange` does at a bus that has no door."""
    return NOT_LENT


class Receiver:
    """Takes every frame of the bus to the part that it is for, and latches the first fault.

    `counters` contains the rejected frames by reason, `last_emergency` the last emergency in
    words. A fault stays until `reset`. The answers are to the SYNC of `syncs`.
    """

    def __init__(
        self,
        config: CanopenPart,
        rig: RigConfig,
        parts: Parts,
        switch: PdoCodec | None,
        bus: can.BusABC,
        counters: Counters,
        syncs: Syncs,
    ) -> None:
        self.counters = counters
        self.fault = NO_AXIS_FAULT
        self.last_emergency = self.complaint = ""
        self._config = config
        self._reader = SlotReader(bus, MOST_FRAMES_PER_CYCLE)
        self._encoder, self._force, self._drive = parts
        self._drivetrain = None
        if config.drivetrain is not None:
            self._drivetrain = Drivetrain(config.drivetrain, rig.limits.velocity_max, rig.period_ns)
        self._channels = [part for part in parts[:2] if part is not None]
        self._replies = [part.replies for part in parts if part is not None]
        # The values come first, so that their place is that of their bit of `intake.settle`.
        records = [part.record for part in parts if part is not None]
        self._sources, self._words = side_by_side(records), counters.words
        if self._drive is not None:
            self._drive.bind(self._drive.record.stored)
        self._readings = self._new_reading()
        self._reading = cast("Reading", self._readings[0])
        self._syncs, self._sync_words = syncs, syncs.view(np.int64).data
        self._names = {node.node_id: name for name, node in config.nodes.items()}
        guarded = {n.node_id: n.guarding.period_ms for n in config.nodes.values() if n.guarding}
        self.guards = NodeGuards(guarded)
        self._heartbeats = HeartbeatConsumer(
            {node.node_id: node.silence_ms for node in config.nodes.values()}, guarded
        )
        intake.load_kernels()
        self._note_sync_sent = bound(intake.note_sync_sent, (self._sources,))
        self._bind(Sample())
        self._switch = switch
        self._handlers = self._handler_table()
        for record in records:
            cob_id = record.source.cob_id
            if cob_id in self._handlers or cob_id in self._heartbeats.lives["cob_id"]:
                record.source.cob_id = NOBODY
        self._watching = False

    def reset(self) -> None:
        """Forget everything that the cycle knows."""
        self.fault = NO_AXIS_FAULT
        self.last_emergency = self.complaint = ""
        self._reading.fault = self._reading.missing = 0
        self._watching = False
        if self._drive is not None:
            self._drive.disarm()
        for channel in self._channels:
            channel.reset()
        if self._drivetrain is not None:
            self._drivetrain.reset()

    def asked(self) -> None:
        """Note that a SYNC is sent: every source owes an answer."""
        self.counters["sync_sent"] += 1
        self._note_sync_sent()

    def _new_reading(self) -> Readings:
        """Return a reading of the parts that there are, which lie in this order."""
        places, count = [], 0
        for part in (self._encoder, self._force, self._drive):
            places.append(NOWHERE if part is None else count)
            count += part is not None
        return new_reading(*places)

    def receive(self, sample: Sample, now_ns: int, *, asks: bool, sends: bool) -> bool:
        """Take the arrived frames and fill the sample; return whether the next SYNC was sent.

        With `asks` the caller sends it right after this, unless a kernel can with `sends`.
        """
        if sample is not self._sample:
            self._bind(sample)
        if not self._watching:
            self._begin(now_ns)
        events, sent = self._exchange(now_ns, asks, sends), sends
        if events < 0:  # seldom
            events, sent = self._take(events, now_ns, asks=asks, sends=sends)
        sample.stale = ""
        if events:
            sent = sent and not events & UNSENT
            self._find_faults(now_ns, events)
            self._correct(sample, events)
        if self._drivetrain is not None:
            self._drivetrain.free(sample)
        sample.complaint = self.last_emergency or self.complaint
        return sent

    def _correct(self, sample: Sample, events: int) -> None:
        """Write the events of its cycle into a filled sample."""
        if events & DUPLICATE - 1:
            sample.stale = self._stale(events)
        sample.fault = self.fault
        if (drive := self._drive) is not None:
            sample.enabled = drive.enabled

    def _take(self, events: int, now_ns: int, *, asks: bool, sends: bool) -> tuple[int, bool]:
        """Take a cycle's frames that `exchange` has not; return events, and whether it sent SYNC.

        `events` are those that it returned.
        """
        reader, count = self._reader, 0
        if events == NOT_LENT and reader.is_lent():
            events = self._exchange(now_ns, asks, sends)
            if events >= 0:  # nearly always
                return events, sends
        if events == NOT_LENT:
            count, events = reader.read_otherwise(), UNUSUAL
        else:
            count = reader.read_unusual() if events == UNUSUAL else reader.received
        take_cycle, sync_ns = self._bound[id(reader.slots)], self._sync_words[SENT]
        if events == UNUSUAL:
            self._note_flood(count)
            events = take_cycle(0, count, sync_ns, now_ns, asks)
        while events < 0:
            row = -1 - events
            self._hand_on(*reader.frame(row)[:2], now_ns)
            events = take_cycle(row + 1, count, sync_ns, now_ns, asks)
        return events, False

    def _bind(self, sample: Sample) -> None:
        """Bind the kernels that take a cycle's frames: from the reader's slots, and by its door.

        It fills this sample from now on.
        """
        self._sample = sample
        lives = self._heartbeats.lives
        arrays = self._sources, self._words, lives, self._readings, sample.stored
        reader = self._reader
        self._exchange: Callable[[int, bool, bool], int] = _without_door
        if (door := reader.door) is not None:
            more = *door.arrays, door.words, self._syncs
            self._exchange = bound(exchange, (*arrays, *more), 0, True, True)  # noqa: FBT003
        self._bound = {
            id(slots): bound(intake.take_cycle, (*arrays, slots), 0, 0, 0, 0, True)  # noqa: FBT003
            for slots in reader.all_slots
        }

    @cached_property
    def _taking(self) -> dict[int, Callable[[int, int, int], int]]:
        """The kernel that takes frames from each of the reader's slots."""
        arrays = self._sources, self._words, self._heartbeats.lives
        return {
            id(slots): bound(intake.take_frames, (*arrays, slots), 0, 0, 0)
            for slots in self._reader.all_slots
        }

    def _stale(self, events: int) -> str:
        """Return the reason why the first value is not new."""
        late = (one.too_old for bit, one in enumerate(self._channels) if events >> bit & 1)
        return next(late)

    def raise_fault(self, fault: AxisFault) -> None:
        """Latch the first fault; later ones are its consequences."""
        if self.fault is NO_AXIS_FAULT:
            self.fault, self._reading.fault = fault, int(fault)

    def _handler_table(self) -> dict[int, Handler]:
        """Return the handler of a frame that is no source's, by its id."""
        daemon = self._config.daemon
        table: dict[int, Handler] = {}
        if self._drive is not None:
            table[self._drive.rpdo.cob_id] = self._on_foreign_master
        if (switch := self._switch) is not None:
            table[switch.cob_id] = lambda _, data, __: self._on_switch(switch, data)
        for node in self._config.nodes.values():
            if node.node_id in self.guards:
                table[BOOT_UP + node.node_id] = self._on_guarded
            table[EMERGENCY + node.node_id] = self._on_emergency
        masters = (setup.NMT, daemon.sync_cob_id, BOOT_UP + daemon.node_id)
        return table | dict.fromkeys(masters, self._on_foreign_master)

    def _on_switch(self, codec: PdoCodec, data: Data) -> None:
        drive = self._config.drive
        if len(data) != codec.struct.size or drive is None or drive.switch is None:
            self.counters["wrong_length"] += 1
            return
        inputs = codec.struct.unpack(data)[codec.slot(drive.switch.entry)]
        self._reading.closed = inputs >> drive.switch.bit & 1 == drive.switch.closed

    def _on_guarded(self, can_id: int, data: Data, now_ns: int) -> None:
        node = can_id & 0x7F
        if len(data) != 1:
            self.counters["wrong_length"] += 1
        elif not self.guards.accepts(node, data[0]):
            self.counters["bad_toggle"] += 1
        else:
            self._heartbeats.heard(node, data[0] & 0x7F, now_ns)

    def _on_emergency(self, can_id: int, data: Data, _: int) -> None:
        if len(data) != EMERGENCY_BYTES:
            self.counters["wrong_length"] += 1
        elif data[0] or data[1]:
            self.counters["emergency"] += 1
            node = self._names.get(can_id & 0x7F, "?")
            self.last_emergency = emergency_in_words(node, bytes(data))
            self.raise_fault(AxisFault.EMERGENCY)

    def _on_foreign_master(self, _: int, __: Data, ___: int) -> None:
        self.counters["foreign_master"] += 1
        self.raise_fault(AxisFault.FOREIGN_MASTER)

    @property
    def answered(self) -> bool:
        """Return whether every source has answered all that it was asked."""
        return all(replies.answered for replies in self._replies)

    def drain(self, now_ns: int) -> None:
        """Hand every waiting frame to its handler; a flood is left for the next cycle."""
        count = self._arrived(now_ns)
        take_frames = self._taking[id(self._reader.slots)]
        row = take_frames(0, count, now_ns)
        while row < count:
            self._hand_on(*self._reader.frame(row)[:2], now_ns)
            row = take_frames(row + 1, count, now_ns)

    def _arrived(self, now_ns: int) -> int:
        """Return how many frames wait now."""
        if not self._watching:
            self._begin(now_ns)
        count = self._reader.read()
        self._note_flood(count)
        return count

    def _begin(self, now_ns: int) -> None:
        """Begin the watch over the devices' life signs, which the first frames may already be."""
        self._watching = True
        self._heartbeats.start(now_ns)
        self.guards.start()

    def _note_flood(self, count: int) -> None:
        if count >= MOST_FRAMES_PER_CYCLE:
            self.counters["flood"] += 1

    def _hand_on(self, can_id: int, data: Data, now_ns: int) -> None:
        """Hand a frame that is no source's to whom it is for."""
        handle = self._handlers.get(can_id)
        if handle is None:
            self._set_aside(can_id, data)
        else:
            handle(can_id, data, now_ns)

    def _set_aside(self, can_id: int, data: Data) -> None:
        """Count a frame that is for nobody here, by its kind."""
        if can_id == UNREADABLE:
            self.counters["unreadable"] += 1
        elif can_id & ERROR:
            self.counters["error_frame"] += 1
            self.raise_fault(error_frame_fault(can_id & EXTENDED_MASK, data))
        elif can_id & REMOTE:
            self.counters["remote_frame"] += 1
        else:
            self.counters["unexpected_id"] += 1

    def _find_faults(self, now_ns: int, events: int) -> None:
        """Latch faults that follow from the devices' silence, a drive's state, a second sender."""
        if events & CHANGED and self._drive is not None and self._drive.settle():
            self.raise_fault(AxisFault.DRIVE_FAULT)
        if events & LOST and self.fault is NO_AXIS_FAULT:
            self._note_lost(now_ns)
        if events & DUPLICATE:
            self.raise_fault(AxisFault.DUPLICATE_NODE)

    def _note_lost(self, now_ns: int) -> None:
        """Latch that a node's heartbeat ended, and name the node."""
        if (lost := self._heartbeats.lost(now_ns)) is not None:
            self.raise_fault(AxisFault.DEVICE_LOST)
            self.complaint = f"{self._names.get(lost, 'node')} (0x{lost:02X}): its heartbeat ended"
