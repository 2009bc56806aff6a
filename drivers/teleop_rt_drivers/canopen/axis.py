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
from teleop_rt_drivers.canopen.sdo import BOOT_UP, ConfigurationBus
from teleop_rt_drivers.canopen.watch import OPERATIONAL, HeartbeatConsumer, error_frame_fault

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config import RigConfig
    from teleop_rt_drivers.canopen.config import CanopenConfig

    Handler = Callable[[can.Message, int], None]

MOST_FRAMES_PER_CYCLE = 256
EMERGENCY, EMERGENCY_BYTES = 0x080, 8
SEND_FAILURES_UNPLUGGED = 3
SPEED_SATURATED = 2**15 - 1


class CanopenAxis:
    """Encoder, force sensor and drive on one CANopen bus, which the axis takes over and closes.

    `counters` tells how many frames were rejected for which reason. A fault stays until
    `configure` is called again.
    """

    def __init__(
        self, config: CanopenConfig, rig: RigConfig, bus: can.BusABC, now_ns: Callable[[], int]
    ) -> None:
        self.counters = new_counters()
        self._config = config
        self._rig = rig
        self._bus = bus
        self._now_ns = now_ns
        self._dictionaries = {
            name: eds.load(node.eds, node.node_id) for name, node in config.nodes.items()
        }
        encoder, force, drive = self._dictionaries.values()
        self._encoder = build.encoder_channel(config.encoder, rig, encoder, self.counters)
        self._force = build.force_channel(config.force, rig, force, self.counters)
        self._drive = build.drive_link(config.drive, drive, self.counters)
        self._speed_slot = (
            None if config.encoder.speed is None else self._encoder.codec.slot(config.encoder.speed)
        )
        self._heartbeats = HeartbeatConsumer(
            {node.node_id: node.heartbeat_timeout_ms for node in config.nodes.values()}
        )
        self._handlers = self._handler_table()
        self._sync = _frame(config.daemon.sync_cob_id, b"")
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
        pdos = {
            "encoder": [self._encoder.codec],
            "force sensor": [self._force.codec],
            "drive": [self._drive.rpdo, self._drive.tpdo],
        }
        for name, node in self._config.nodes.items():
            setup.restart(nodes[name], bus)
            setup.configure_node(nodes[name], node, pdos[name])
        if (resolution := self._config.encoder.resolution) is not None:
            setup.check_resolution(nodes["encoder"], resolution, self._config.encoder.scale)
        setup.configure_drive(nodes["drive"], self._config, self._rig)
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
        self._drive.arm()

    def read_into(self, sample: Sample) -> None:
        """Drain the answers to the last SYNC, then send the next SYNC. Never raises."""
        now_ns = self._now_ns()
        if not self._watching:
            self._watching = True
            self._heartbeats.start(now_ns)
        self._drain(now_ns)
        new_position = self._encoder.settle(self._sync_ns)
        new_force = self._force.settle(self._sync_ns)
        self._drive.settle()
        self._find_faults(now_ns)
        self._send_sync()
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + self._heartbeat_period_ns
            self._send(self._heartbeat)
        sample.valid = new_position and new_force
        self._fill(sample)

    def write(self, position: float) -> None:
        """Command a position [rig unit], executed at the next SYNC once the drive is enabled."""
        self._send(_frame(self._drive.rpdo.cob_id, self._drive.command(position)))

    def stop(self) -> None:
        """Quick-stop the drive at once, with a SYNC of its own. Never raises.

        Before `configure` has found the devices to be ours nothing is sent: the network may be
        another master's.
        """
        if not self._master:
            return
        self._send(_frame(self._drive.rpdo.cob_id, self._drive.stop_command()))
        self._send_sync()

    def close(self) -> None:
        """Stop the drive, take the devices out of operation and release the bus."""
        self.stop()
        if self._master:
            self._send_nmt(setup.STOP_NODE, self._config.drive.node_id)
            self._send_nmt(setup.PRE_OPERATIONAL, self._config.encoder.node_id)
            self._send_nmt(setup.PRE_OPERATIONAL, self._config.force.node_id)
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
        self._drive.disarm()
        self._encoder.reset()
        self._force.reset()

    def _handler_table(self) -> dict[int, Handler]:
        """Return what to do with a frame, by its id."""
        daemon = self._config.daemon
        table: dict[int, Handler] = {
            self._encoder.codec.cob_id: self._on_encoder,
            self._force.codec.cob_id: self._on_force,
            self._drive.tpdo.cob_id: self._on_drive,
        }
        for node in self._config.nodes.values():
            table[BOOT_UP + node.node_id] = self._on_heartbeat
            table[EMERGENCY + node.node_id] = self._on_emergency
        masters = (
            setup.NMT,
            daemon.sync_cob_id,
            BOOT_UP + daemon.node_id,
            self._drive.rpdo.cob_id,
        )
        return table | dict.fromkeys(masters, self._on_foreign_master)

    def _on_encoder(self, message: can.Message, _: int) -> None:
        fields = self._encoder.take(message.data)
        if self._speed_slot is not None and fields is not None:
            self.counters["speed_saturated"] += abs(fields[self._speed_slot]) >= SPEED_SATURATED

    def _on_force(self, message: can.Message, _: int) -> None:
        self._force.take(message.data)

    def _on_drive(self, message: can.Message, _: int) -> None:
        self._drive.take(message.data)

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
        if self._drive.faulty or self._drive.fell_out:
            self._raise_fault(AxisFault.DRIVE_FAULT)
        if self._heartbeats.lost(now_ns) is not None:
            self._raise_fault(AxisFault.DEVICE_LOST)
        for source in (self._encoder, self._force, self._drive):
            if source.replies.duplicate:
                self._raise_fault(AxisFault.DUPLICATE_NODE)

    def _raise_fault(self, fault: AxisFault) -> None:
        """Latch the first fault; later ones are its consequences."""
        if self._fault is AxisFault.NONE:
            self._fault = fault

    def _fill(self, sample: Sample) -> None:
        """Write what is known into the caller's sample; `valid` is already set."""
        encoder, force = self._encoder, self._force
        self._missing = 0 if sample.valid else self._missing + 1
        self.counters["cycles_without_sample"] += not sample.valid
        sample.position = encoder.value
        sample.force = force.value
        sample.position_stamp_ns = encoder.stamp_ns
        sample.force_stamp_ns = force.stamp_ns
        sample.stamp_ns = min(encoder.stamp_ns, force.stamp_ns)
        sample.enabled = self._drive.enabled
        sample.missing = self._missing
        sample.rejected = rejected(self.counters)
        sample.fault = self._fault

    def _send_sync(self) -> None:
        """Send SYNC and note its time: the answers will be stamped with it."""
        self._sync_ns = self._now_ns()
        self.counters["sync_sent"] += 1
        self._encoder.replies.asked()
        self._force.replies.asked()
        self._drive.replies.asked()
        self._send(self._sync)

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


def _frame(cob_id: int, data: bytes) -> can.Message:
    """Return a frame with an 11-bit id."""
    return can.Message(arbitration_id=cob_id, is_extended_id=False, data=data)
