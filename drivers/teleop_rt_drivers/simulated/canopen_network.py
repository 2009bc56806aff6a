"""The CANopen side of the simulated rig: three nodes around the plant on one bus."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, cast

import can

from teleop_rt_drivers.can_frames import ERROR, EXTENDED, REMOTE, reader_of, sender_of
from teleop_rt_drivers.simulated.answer import LONGEST_WAIT_NS
from teleop_rt_drivers.simulated.answering import Answering
from teleop_rt_drivers.simulated.devices import Encoder, ForceSensor
from teleop_rt_drivers.simulated.drive import ServoDrive
from teleop_rt_drivers.simulated.faults import LASTING, FaultyWire, break_bus, break_drive, mend_bus
from teleop_rt_drivers.simulated.senses import LONGEST_ANSWERING_NS

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Sequence

    from teleop_rt_drivers.can_frames import CanFrame, Outgoing
    from teleop_rt_drivers.canopen.config import CanopenPart
    from teleop_rt_drivers.simulated.device import Node
    from teleop_rt_drivers.simulated.faults import LastingFault
    from teleop_rt_drivers.simulated.hidden_motion import Matrix
    from teleop_rt_drivers.simulated.plant import Plant
    from teleop_rt_drivers.simulated.rig import Network
    from teleop_rt_drivers.simulated.serial_network import SerialNetwork

NMT, HEARTBEAT, SDO_REQUEST = 0x000, 0x700, 0x600  # COB-IDs without the node's id (CiA 301)
HARDWARE_FAULT, DEVICE_SPECIFIC, RECOVERED_FROM_BUS_OFF = 0x5000, 0xFF01, 0x8140
"""Emergency codes (CiA 301, table 26)."""
TIMERS_NS = 5_000_000
"""A timer that is looked at always is looked at this often."""
TIMERS_APART_NS = 500_000
"""On the machine's clock the timers run once in a millisecond, not again after its command."""
AT_ONCE = 64
"""Frames that are handled at most before the timers run."""


class CanopenNetwork:
    """Encoder, force sensor and drive as CANopen nodes, those that the config has.

    `latched` is called after each SYNC, when the plant stands at the time that devices latched; or
    `note` with the rows of `signals.TRUTH` of several.
    """

    def __init__(
        self,
        axis: CanopenPart,
        plant: Plant,
        bus: can.BusABC,
        now_ns: Callable[[], int],
        seed: int,
        latched: Callable[[], None],
        note: Callable[[Matrix], None],
    ) -> None:
        self.lost_frames = 0
        self.drive: ServoDrive | None = None
        self.devices: dict[str, Node] = {}
        self._beside: SerialNetwork | None = None
        self._cut = False
        self._timed_ns = -1
        self._plant = plant
        self._bus = bus
        self._waiting_frames, self._send_frames = reader_of(bus), sender_of(bus)
        self._batches = hasattr(bus, "send_frames")
        self._gathers = False
        self._outgoing: list[Outgoing] = []
        self._now_ns = now_ns
        self._latched = latched
        self._sync_cob_id = axis.daemon.sync_cob_id
        self._wire = FaultyWire(self._transmit, seed)
        send = self._wire.send
        if axis.encoder is not None:
            self.devices["encoder"] = Encoder(axis.encoder, send, plant)
        if axis.force_sensor is not None:
            self.devices["force sensor"] = ForceSensor(axis.force_sensor, send, plant)
        if axis.drive is not None:
            self.devices["drive"] = self.drive = ServoDrive(axis.drive, send, plant)
        self._by_node = {device.node_id: device for device in self.devices.values()}
        self._nodes = tuple(self._by_node.values())
        self._answering = Answering(
            bus,
            plant,
            self._wire,
            self._nodes,
            self.drive,
            now_ns,
            note,
            sync_id=self._sync_cob_id,
            heartbeat_id=HEARTBEAT + axis.daemon.node_id,
        )

    def power_on(self) -> None:
        """Boot every device."""
        for device in self._nodes:
            device.boot()

    def inject(self, fault: str, device: str) -> bool:
        """Inject a fault by name; false where this network knows no such fault."""
        self._answering.hand_back()
        node = self.devices[device]
        if fault == "reset":
            node.boot()
        elif fault == "emergency":
            node.emergency(HARDWARE_FAULT)
        elif fault == "device_error":
            node.emergency(DEVICE_SPECIFIC)
        elif fault == "bus_off":
            self._wire.bus_off()
        elif fault in LASTING:
            self._wire.inject(cast("LastingFault", fault), node.node_id)
        elif break_bus(fault, self._bus):
            self._wire.off = self._cut = True
        else:
            return break_drive(fault, self.drive)
        return True

    def heal(self, device: str) -> None:
        """End the device's lasting fault, or give all of them their power back."""
        self._answering.hand_back()
        self._wire.heal(self.devices[device].node_id)
        if self._cut:
            self._cut = self._wire.off = False
            self.power_on()
            mend_bus(self._bus)
        elif self._wire.off:
            self._wire.off = False
            for node in self._nodes:
                node.emergency(RECOVERED_FROM_BUS_OFF)

    def process(self) -> None:
        """Handle the frames that wait, as of now."""
        now_ns, handled = self._now_ns(), False
        while frames := self._waiting_frames(AT_ONCE):
            handled = True
            for can_id, data, _ in frames:
                self._handle(can_id, bytes(data), now_ns)
            if len(frames) < AT_ONCE:
                break
        if handled or now_ns != self._timed_ns:  # else they have run at this very instant
            self._run_timers(now_ns)

    def serve_once(self, readable: Collection[int]) -> None:  # noqa: ARG002 - there is one bus
        """Handle the frames that wait, as of when the kernel received each."""
        self._take(self._answering.left() if self._answering.is_ready() else None)

    @property
    def together(self) -> tuple[Network, ...]:
        """The networks whose frames it answers, if they do nothing else."""
        return (self,) if self._beside is None else (self, self._beside)

    def send_beside(self, sensors: SerialNetwork) -> None:
        """Send the frames of a network of sensors, too, while it answers until a time."""
        if sensors.answering is not None and sensors.answering.drive is None:
            self._beside = sensors
            self._answering.send_meanwhile(sensors.answering.lines, sensors.answering.timer)

    def answer_until(self, until_ns: int, descriptors: list[int]) -> tuple[Network, ...]:
        """Handle the frames that come until then, or until one of these descriptors is readable.

        Return the networks for which it did: none where devices do more than answer the frames of
        every cycle.
        """
        if not self._answering.is_ready():
            return ()
        self._answering.watch(descriptors)
        now_ns = self._now_ns()
        until_ns = min(until_ns, self._timers_due_ns(now_ns))
        beside = self._beside
        if beside is None:
            self._take(self._answering.left(until_ns))
            return (self,)
        sends = beside.begin()
        if not sends:
            until_ns = min(until_ns, beside.due_ns(now_ns))
        self._take(self._answering.left(until_ns))
        beside.end()
        return (self, beside) if sends else (self,)

    def _take(self, frames: Sequence[CanFrame] | None) -> None:
        """Handle frames, or those that wait, and run the timers."""
        if frames is None:
            self._answering.hand_back()
            frames = self._waiting_frames(AT_ONCE)  # later and further frames are for the next call
        for can_id, data, sent_ns in frames:
            now_ns = self._now_ns()  # as frames are stamped where devices are served
            age_ns = now_ns - sent_ns if sent_ns else 0
            stamp_ns = now_ns - min(max(0, age_ns), LONGEST_WAIT_NS)
            self._handle(can_id, bytes(data), stamp_ns)
        now_ns = self._now_ns()
        if now_ns - self._timed_ns >= TIMERS_APART_NS:
            self._run_timers(now_ns)

    def due_ns(self, now_ns: int) -> int:
        """Return when the first timer ends; a time soon enough where one is looked at always.

        A heartbeat that a kernel is to send is due here, too: it may have no turn any more by then.
        """
        return min(self._timers_due_ns(now_ns), self._answering.heartbeat_due_ns)

    def _timers_due_ns(self, now_ns: int) -> int:
        quiet_ns = min(device.quiet_until_ns for device in self._nodes)
        if quiet_ns <= now_ns:
            return now_ns + TIMERS_NS
        return min(quiet_ns, now_ns + LONGEST_ANSWERING_NS)

    def descriptors(self) -> list[int]:
        """Return the descriptor that becomes readable when there is something to do."""
        return self._descriptors

    @cached_property
    def _descriptors(self) -> list[int]:
        return [self._bus.fileno()]

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def _transmit(self, can_id: int, data: bytes) -> None:
        """Send a device's frame, at once or with the other answers to a SYNC."""
        self._outgoing.append((can_id, data))
        if not self._gathers:
            self._flush()

    def _flush(self) -> None:
        """Send the waiting frames; one that the bus does not take is lost, as on a wire."""
        frames, self._outgoing = self._outgoing, []
        try:
            self._send_frames(frames)
        except can.CanError:
            self.lost_frames += len(frames)

    def _handle(self, cob_id: int, data: bytes, stamp_ns: int) -> None:
        """Give a frame to the devices that it is for; other packets have a negative id."""
        if self._wire.off or cob_id < 0 or cob_id & (ERROR | EXTENDED):
            return
        if cob_id & REMOTE:
            asked = self._by_node.get(cob_id & 0x7F)
            if cob_id & 0x780 == HEARTBEAT and asked is not None:
                asked.receive_guard(stamp_ns)
            return
        if cob_id == self._sync_cob_id:
            self._sync(stamp_ns)
        elif cob_id == NMT:
            self._network_management(data)
        elif cob_id & 0x780 == HEARTBEAT:
            for device in self._nodes:
                device.receive_heartbeat(cob_id & 0x7F, stamp_ns)
        elif cob_id & 0x780 == SDO_REQUEST:
            if (node := self._by_node.get(cob_id & 0x7F)) is not None:
                node.receive_sdo(data)
        else:
            self._plant.advance(stamp_ns)  # a command may act at once
            for device in self._nodes:
                if cob_id in device.rpdos:
                    device.receive_pdo(cob_id, data)

    def _sync(self, stamp_ns: int) -> None:
        """Latch the plant at the time of SYNC, act on commands, send the answers."""
        self._plant.advance(stamp_ns)
        self._gathers = self._batches
        for device in self._nodes:
            device.sync()
        if self._gathers:
            self._gathers = False
            self._flush()
        self._latched()

    def _network_management(self, data: bytes) -> None:
        if len(data) != 2:
            return
        for device in self._nodes:
            if data[1] in (0, device.node_id):
                device.receive_nmt(data[0])

    def _run_timers(self, now_ns: int) -> None:
        self._timed_ns = now_ns
        for device in self._nodes:
            if now_ns >= device.quiet_until_ns:
                device.run_timers(now_ns)
