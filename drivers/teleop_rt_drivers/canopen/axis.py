"""The axis on CANopen: SYNC from the loop, answers one cycle later, nothing blocks, nothing raises.

A cycle is `read_into` (drain the answers to the last SYNC, send the next SYNC) and `write` (the
command frame, executed by the drive at the next SYNC). `write` belongs to every cycle, also
while the drive is not enabled: it carries the controlword.
"""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import can

from teleop_rt.axis import AxisError, AxisFault, Sample
from teleop_rt_drivers.canopen import build, eds, setup
from teleop_rt_drivers.canopen.counters import new_counters, rejected
from teleop_rt_drivers.canopen.emergency import emergency_in_words
from teleop_rt_drivers.canopen.sdo import BOOT_UP, ConfigurationBus
from teleop_rt_drivers.canopen.watch import OPERATIONAL, HeartbeatConsumer, error_frame_fault

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config import RigConfig
    from teleop_rt_drivers.canopen.channel import Channel
    from teleop_rt_drivers.canopen.config import CanopenPart, DaemonConfig
    from teleop_rt_drivers.canopen.pdo import PdoCodec

    Handler = Callable[[can.Message, int], object]

MOST_FRAMES_PER_CYCLE = 256
EMERGENCY, EMERGENCY_BYTES = 0x080, 8
SEND_FAILURES_UNPLUGGED = 3
SPEED_SATURATED = 2**15 - 1


class CanopenAxis:
    """Encoder, force sensor and drive on one CANopen bus, which the axis takes over and closes.

    `counters` tells how many frames were rejected for which reason, `last_emergency` what a device
    complained of. A fault stays until
    `configure` is called again.
    """

    def __init__(
        self, config: CanopenPart, rig: RigConfig, bus: can.BusABC, now_ns: Callable[[], int]
    ) -> None:
        self.counters = new_counters()
        self._config = config
        self._rig = rig
        self._bus = bus
        self._now_ns = now_ns
        self._dictionaries = {
            name: eds.load(node.eds, node.node_id) for name, node in config.nodes.items()
        }
        parts = build.parts(config, rig, self._dictionaries, self.counters)
        self._encoder, self._force, self._drive = parts
        self._channels = [part for part in parts[:2] if part is not None]
        self._sources = [part.replies for part in parts if part is not None]
        self._speed_slot = build.speed_slot(config, self._encoder)
        self._names = {node.node_id: name for name, node in config.nodes.items()}
        self._heartbeats = HeartbeatConsumer(
            {node.node_id: node.heartbeat_timeout_ms for node in config.nodes.values()}
        )
        self._handlers = self._handler_table()
        self._syncs = _sync_frames(config.daemon)
        self._sync_count = 0
        self.last_emergency = ""
        self._heartbeat = _frame(BOOT_UP + config.daemon.node_id, bytes((OPERATIONAL,)))
        self._heartbeat_period_ns = config.daemon.heartbeat_ms * 1_000_000
        self._fault = AxisFault.NONE
        self._missing = 0
        self._send_failures = 0
        self._sync_ns = 0
        self._heartbeat_due_ns = 0
        self._watching = False
        self._master = False

    def configure(self) -> None:
        """Find, check and configure the devices; nothing moves. Raises AxisError."""
        bus = ConfigurationBus(self._bus, self._now_ns)
        setup.refuse_other_masters(bus, self._config)
        nodes = build.sdo_nodes(self._config, self._dictionaries, bus)
        for name, node in self._config.nodes.items():
            eds.check_against_config(self._dictionaries[name], node, nodes[name].label)
            setup.check_identity(nodes[name], node, self._config.daemon.attempts)
        self._master = True
        pdos = self._pdos()
        for name, node in self._config.nodes.items():
            setup.restart(nodes[name], bus)
            setup.configure_node(nodes[name], node, pdos[name], self._config.daemon)
        if (encoder := self._config.encoder) is not None and encoder.resolution is not None:
            setup.check_resolution(nodes["encoder"], encoder.resolution, encoder.scale)
        if (drive := self._config.drive) is not None:
            setup.configure_drive(nodes["drive"], drive, self._config.daemon, self._rig)
        self._reset_cycle_state()
        for node in self._config.nodes.values():
            bus.send(setup.NMT, bytes((setup.START, node.node_id)))

    def arm(self) -> None:
        """Ask the drive to hold its present position under power; takes effect over cycles.

        Raises AxisError before `configure`, and while a fault is latched: only `configure`
        clears it.
        """
        if not self._master:
            raise AxisError("cannot arm: the devices are not configured")
        if self._fault is not AxisFault.NONE:
            raise AxisError(f"cannot arm: {self._fault.name}; remove the cause and configure again")
        if self._drive is not None:
            self._drive.arm()

    def read_into(self, sample: Sample) -> None:
        """Drain the answers to the last SYNC, then send the next SYNC. Never raises."""
        now_ns = self._now_ns()
        if not self._watching:
            self._watching = True
            self._heartbeats.start(now_ns)
        self._drain(now_ns)
        new = [channel.settle(self._sync_ns) for channel in self._channels]
        if self._drive is not None:
            self._drive.settle()
        self._find_faults(now_ns)
        self._send_sync()
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + self._heartbeat_period_ns
            self._send(self._heartbeat)
        sample.valid = all(new)
        self._fill(sample)

    def write(self, position: float) -> None:
        """Command a position [rig unit], executed at the next SYNC once the drive is enabled."""
        if self._drive is not None:
            self._send(_frame(self._drive.rpdo.cob_id, self._drive.command(position)))

    def stop(self) -> None:
        """Quick-stop the drive at once, with a SYNC of its own. Never raises.

        Before `configure` has found the devices to be ours nothing is sent: the network may be
        another master's.
        """
        if not self._master or self._drive is None:
            return
        self._send(_frame(self._drive.rpdo.cob_id, self._drive.stop_command()))
        self._send_sync()

    def close(self) -> None:
        """Stop the drive, take the devices out of operation and release the bus."""
        self.stop()
        if self._master:
            for name, node in reversed(self._config.nodes.items()):
                last = setup.STOP_NODE if name == "drive" else setup.PRE_OPERATIONAL
                self._send_nmt(last, node.node_id)
        self._master = False
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()

    def _reset_cycle_state(self) -> None:
        """Forget everything that the cycle knows."""
        self._fault = AxisFault.NONE
        self._missing = 0
        self._send_failures = 0
        self._sync_ns = 0
        self._heartbeat_due_ns = 0
        self._watching = False
        if self._drive is not None:
            self._drive.disarm()
        for channel in self._channels:
            channel.reset()

    def _pdos(self) -> dict[str, list[PdoCodec]]:
        """Return the process data objects to map, by device."""
        pdos: dict[str, list[PdoCodec]] = {}
        if self._encoder is not None:
            pdos["encoder"] = [self._encoder.codec]
        if self._force is not None:
            pdos["force sensor"] = [self._force.codec]
        if self._drive is not None:
            pdos["drive"] = [self._drive.rpdo, self._drive.tpdo]
        return pdos

    def _handler_table(self) -> dict[int, Handler]:
        """Return what to do with a frame, by its id."""
        daemon = self._config.daemon
        table: dict[int, Handler] = {}
        if (encoder := self._encoder) is not None:
            table[encoder.codec.cob_id] = lambda message, _: self._on_encoder(encoder, message)
        if (force := self._force) is not None:
            table[force.codec.cob_id] = lambda message, _: force.take(message.data)
        if (drive := self._drive) is not None:
            table[drive.tpdo.cob_id] = lambda message, _: drive.take(message.data)
            table[drive.rpdo.cob_id] = self._on_foreign_master
        for node in self._config.nodes.values():
            table[BOOT_UP + node.node_id] = self._on_heartbeat
            table[EMERGENCY + node.node_id] = self._on_emergency
        masters = (setup.NMT, daemon.sync_cob_id, BOOT_UP + daemon.node_id)
        return table | dict.fromkeys(masters, self._on_foreign_master)

    def _on_encoder(self, encoder: Channel, message: can.Message) -> None:
        fields = encoder.take(message.data)
        if self._speed_slot is not None and fields is not None:
            self.counters["speed_saturated"] += abs(fields[self._speed_slot]) >= SPEED_SATURATED

    def _on_heartbeat(self, message: can.Message, now_ns: int) -> None:
        if len(message.data) == 1:
            self._heartbeats.heard(message.arbitration_id & 0x7F, message.data[0] & 0x7F, now_ns)
        else:
            self.counters["wrong_length"] += 1

    def _on_emergency(self, message: can.Message, _: int) -> None:
        if len(message.data) != EMERGENCY_BYTES:
            self.counters["wrong_length"] += 1
        elif message.data[0] or message.data[1]:
            self.counters["emergency"] += 1
            node = self._names.get(message.arbitration_id & 0x7F, "?")
            self.last_emergency = emergency_in_words(node, bytes(message.data))
            self._raise_fault(AxisFault.EMERGENCY)

    def _on_foreign_master(self, _: can.Message, __: int) -> None:
        self.counters["foreign_master"] += 1
        self._raise_fault(AxisFault.FOREIGN_MASTER)

    def _drain(self, now_ns: int) -> None:
        """Hand every waiting frame to its handler; a flood is left for the next cycle."""
        counters, handlers = self.counters, self._handlers
        for _ in range(MOST_FRAMES_PER_CYCLE):
            try:
                message = self._bus.recv(0)
            except (can.CanError, OSError, ValueError):
                counters["unreadable"] += 1
                continue
            if message is None:
                return
            if message.is_error_frame:
                counters["error_frame"] += 1
                self._raise_fault(error_frame_fault(message))
            elif message.is_remote_frame:
                counters["remote_frame"] += 1
            elif message.is_extended_id or message.arbitration_id not in handlers:
                counters["unexpected_id"] += 1
            else:
                handlers[message.arbitration_id](message, now_ns)
        counters["flood"] += 1

    def _find_faults(self, now_ns: int) -> None:
        """Latch what the devices' silence and states tell."""
        if self._drive is not None and (self._drive.faulty or self._drive.fell_out):
            self._raise_fault(AxisFault.DRIVE_FAULT)
        if self._heartbeats.lost(now_ns) is not None:
            self._raise_fault(AxisFault.DEVICE_LOST)
        for source in self._sources:
            if source.duplicate:
                self._raise_fault(AxisFault.DUPLICATE_NODE)

    def _raise_fault(self, fault: AxisFault) -> None:
        """Latch the first fault; later ones are its consequences."""
        if self._fault is AxisFault.NONE:
            self._fault = fault

    def _fill(self, sample: Sample) -> None:
        """Write what is known into the caller's sample; `valid` is already set."""
        self._missing = 0 if sample.valid else self._missing + 1
        self.counters["cycles_without_sample"] += not sample.valid
        if (encoder := self._encoder) is not None:
            sample.position = encoder.value
            sample.position_stamp_ns = encoder.stamp_ns
        if (force := self._force) is not None:
            sample.force = force.value
            sample.force_stamp_ns = force.stamp_ns
        sample.stamp_ns = min((channel.stamp_ns for channel in self._channels), default=0)
        sample.enabled = self._drive is not None and self._drive.enabled
        sample.missing = self._missing
        sample.rejected = rejected(self.counters)
        sample.fault = self._fault

    def _send_sync(self) -> None:
        """Send SYNC and note its time: the answers will be stamped with it."""
        self._sync_ns = self._now_ns()
        self.counters["sync_sent"] += 1
        for source in self._sources:
            source.asked()
        self._send(self._syncs[self._sync_count])
        self._sync_count = (self._sync_count + 1) % len(self._syncs)

    def _send_nmt(self, command: int, node_id: int) -> None:
        self._send(_frame(setup.NMT, bytes((command, node_id))))

    def _send(self, message: can.Message) -> None:
        """Send without waiting; a frame that cannot be sent is counted."""
        try:
            self._bus.send(message, 0)
        except (can.CanError, OSError):
            self.counters["send_failed"] += 1
            self._send_failures += 1
            if self._send_failures >= SEND_FAILURES_UNPLUGGED:
                self._raise_fault(AxisFault.UNPLUGGED)
        else:
            self._send_failures = 0


def _sync_frames(daemon: DaemonConfig) -> list[can.Message]:
    """Return the SYNC frames in turn: one, or one for each count."""
    if daemon.sync_counter is None:
        return [_frame(daemon.sync_cob_id, b"")]
    counts = range(1, daemon.sync_counter + 1)
    return [_frame(daemon.sync_cob_id, bytes((count,))) for count in counts]


def _frame(cob_id: int, data: bytes) -> can.Message:
    """Return a frame with an 11-bit id."""
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)
