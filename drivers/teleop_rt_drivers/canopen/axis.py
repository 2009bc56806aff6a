"""The axis on CANopen: SYNC from the loop, answers one cycle later, nothing blocks, nothing raises.

A cycle is `read_into` (drain the answers to the last SYNC, send the next SYNC) and `write` (the
command frame, executed by the drive at the next SYNC). `write` belongs to every cycle, also
while the drive is not enabled: it carries the controlword.
"""

from __future__ import annotations

import contextlib
import time
from typing import TYPE_CHECKING

import can
import numpy as np

from teleop_rt.axis import NO_AXIS_FAULT, AxisError, AxisFault, Sample, Timing
from teleop_rt.kernels.jit import bound
from teleop_rt_drivers.can_door import LENGTH_SHIFT, put_frame
from teleop_rt_drivers.can_frames import REMOTE, single_sender_of
from teleop_rt_drivers.canopen import build, eds, setup
from teleop_rt_drivers.canopen.config import CanopenDeviceConfig
from teleop_rt_drivers.canopen.counters import Counters
from teleop_rt_drivers.canopen.exchange import COUNT, SENT, new_sync, note_sent
from teleop_rt_drivers.canopen.receiver import Receiver
from teleop_rt_drivers.canopen.sdo import BOOT_UP, ConfigurationBus
from teleop_rt_drivers.canopen.watch import OPERATIONAL, SEND_FAILURES_FAULT, purge, send_fault
from teleop_rt_drivers.quantity import FROM_INPUT
from teleop_rt_drivers.transport import canopen_transport, timing_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt.config.rig import RigConfig
    from teleop_rt_drivers.can_door import CanDoor
    from teleop_rt_drivers.canopen.config import CanopenPart
    from teleop_rt_drivers.canopen.pdo import PdoCodec

_NOT_ACKNOWLEDGED = AxisFault.NOT_ACKNOWLEDGED


class CanopenAxis:
    """Encoder, force sensor and drive on one CANopen bus, which the axis takes over and closes.

    `counters` contains the rejected frames by reason. A fault stays until
    `configure` is called again.
    """

    def __init__(
        self, config: CanopenPart, rig: RigConfig, bus: can.BusABC, now_ns: Callable[[], int]
    ) -> None:
        self.counters = Counters()
        self._config = config
        self._rig = rig
        self._bus = bus
        self._send_frame = single_sender_of(bus)
        self._now_ns = now_ns
        self._dictionaries = {
            name: eds.load(node.eds, node.node_id) for name, node in config.nodes.items()
        }
        for name, node in config.nodes.items():
            label = f"node 0x{node.node_id:02X} ({name})"
            eds.check_against_config(self._dictionaries[name], node, label)
        self._parts = build.axis_parts(config, rig, self._dictionaries, self.counters)
        self._drive = self._parts[2]
        self._switch = build.switch_codec(config.drive, self._dictionaries.get("drive"))
        self._syncs = new_sync(config.daemon.sync_cob_id, config.daemon.sync_counter)
        self._sync_words = self._syncs.view(np.int64).data
        self._note_sync = bound(note_sent, (self._syncs,), 0)
        self._receiver = Receiver(
            config, rig, self._parts, self._switch, bus, self.counters, self._syncs
        )
        # A kernel reads the machine's clock alone.
        self._sends = now_ns is time.monotonic_ns
        door: CanDoor | None = getattr(bus, "door", None)
        drive = self._drive
        self._send_position = None if drive is None or door is None else drive.sender(door)
        self._put_frame = (
            None if door is None else bound(put_frame, (door.arrays[0], door.words), 0, 0)
        )
        guarded = any(node.guarding for node in config.nodes.values())
        self._guards = self._receiver.guards if guarded else None
        self._sync_id = config.daemon.sync_cob_id
        self._heartbeat_id = BOOT_UP + config.daemon.node_id
        self._heartbeat_period_ns = config.daemon.heartbeat_ms * 1_000_000
        self._heartbeat_due_ns = 0
        self._send_failures = 0
        self._master = False
        self._answer_ns = 0
        if isinstance(config, CanopenDeviceConfig) and config.answer_within_ms is not None:
            self._answer_ns = round(1e6 * config.answer_within_ms)

    @property
    def last_emergency(self) -> str:
        """Return a device's last complaint, in words."""
        return self._receiver.last_emergency

    @property
    def timing(self) -> Timing:
        """Return the part of an operator's device's latency by bus, frames and drive, at worst."""
        if not isinstance(self._config, CanopenDeviceConfig):
            raise AxisError("only an operator's device answers with a force: name the rig of one")
        return timing_of(canopen_transport(self._config, self._rig), self._rig)

    def configure(self) -> None:
        """Find, check and configure the devices; nothing moves. Raises AxisError."""
        bus = ConfigurationBus(self._bus, self._now_ns)
        setup.refuse_other_masters(bus, self._config)
        nodes = build.sdo_nodes(self._config, self._dictionaries, bus)
        for name, node in self._config.nodes.items():
            setup.call_back(nodes[name], bus)
            setup.check_identity(nodes[name], node, self._config.daemon.attempts)
        self._master = True
        pdos = self._pdos()
        for name, node in self._config.nodes.items():
            setup.restart(nodes[name], bus)
            setup.configure_node(nodes[name], node, pdos[name], self._config.daemon)
        if (encoder := self._config.encoder) is not None and encoder.resolution is not None:
            setup.check_resolution(nodes["encoder"], encoder.resolution, encoder.scale)
        if (force := self._config.force_sensor) is not None:
            setup.check_force_scale(nodes["force sensor"], force, self._rig)
        if (drive := self._config.drive) is not None:
            setup.configure_drive(nodes["drive"], drive, self._config.daemon, self._rig)
        self.listen()
        for node in self._config.nodes.values():
            bus.send(setup.NMT, bytes((setup.START, node.node_id)))

    def listen(self) -> None:
        """Begin with frames that arrive from now on, on devices that are configured."""
        self._receiver.reset()
        self._send_failures = self._sync_words[SENT] = self._heartbeat_due_ns = 0

    def arm(self) -> None:
        """Ask the drive to hold its present position under power; takes effect over cycles.

        Raises AxisError before `configure`, and while a fault is latched: only `configure`
        clears it.
        """
        if not self._master:
            raise AxisError(
                "cannot arm: the devices are not configured; `teleop-rt reset` configures them"
            )
        if (fault := self._receiver.fault) is not NO_AXIS_FAULT:
            raise AxisError(f"cannot arm: {fault.name}; remove the cause and configure again")
        if self._drive is not None:
            self._drive.arm()

    def read_into(self, sample: Sample) -> None:
        """Drain the answers to the last SYNC, then send the next SYNC. Never raises.

        A device that answers in the same cycle is asked first and waited for, at most its time.
        """
        now_ns = self._now_ns()
        if self._answer_ns:
            self._ask()
            self._await_answers(now_ns)
            self._receiver.receive(sample, now_ns, asks=False, sends=False)
        elif self._receiver.receive(sample, now_ns, asks=True, sends=self._sends):
            self._send_failures = 0
        else:
            self._send_sync()
        if now_ns >= self._heartbeat_due_ns:
            self._heartbeat_due_ns = now_ns + self._heartbeat_period_ns
            self._send_heartbeat()
        if self._guards is not None:
            for node in self._guards.due(now_ns):
                self._send(BOOT_UP + node | REMOTE, b"")

    def _send_heartbeat(self) -> None:
        """Send our own heartbeat: a tick in which it is due takes little longer than others."""
        put, head = self._put_frame, self._heartbeat_id | 1 << LENGTH_SHIFT
        if put is None or put(head, OPERATIONAL) < 0:  # also where the door is closed
            self._send(self._heartbeat_id, bytes((OPERATIONAL,)))
        else:
            self._send_failures = 0

    def _await_answers(self, asked_ns: int) -> None:
        """Take frames until all answers to this SYNC are there, or their time is over."""
        receiver, last_ns = self._receiver, -1
        while True:
            now_ns = self._now_ns()
            receiver.drain(now_ns)
            # A clock that stands still while we wait is a simulated one: nothing more will come.
            if receiver.answered or now_ns == last_ns or now_ns - asked_ns > self._answer_ns:
                return
            last_ns = now_ns

    def write(self, position: float) -> None:
        """Command a position [rig unit], executed at the next SYNC once the drive is enabled.

        Where nothing acknowledges nothing is commanded: it would wait, and act when power returns.
        """
        drive = self._drive
        if drive is None or self._receiver.fault is _NOT_ACKNOWLEDGED:
            return
        send = self._send_position
        if send is None or send(position) < 0:  # also where the door is closed
            self._send(drive.rpdo.cob_id, drive.command(position))
        else:  # nearly always
            self._send_failures = 0

    def push(self, force: float) -> None:
        """Command a force [rig unit] in place of a position, as an operator's device does.

        Raises AxisError where the drive is not in torque mode.
        """
        if self._drive is None or self._drive.takes_positions:
            raise AxisError(
                "drive.torque is missing: add it, for an operator's device is driven by force"
            )
        if self._receiver.fault is not _NOT_ACKNOWLEDGED:
            self._send(self._drive.rpdo.cob_id, self._drive.force_command(force))

    def stop(self) -> None:
        """Quick-stop the drive at once, with a SYNC of its own. Never raises.

        Before `configure` has found the devices to be ours nothing is sent: the network may be
        another master's.
        """
        if not self._master or self._drive is None:
            return
        self._send(self._drive.rpdo.cob_id, self._drive.stop_command())
        self._ask()

    def close(self) -> None:
        """Stop the drive, take the devices out of operation and release the bus.

        Being stopped as a node makes a drive stop its motor (6007h); left so, it would answer
        nobody who comes next.
        """
        self.stop()
        if self._master:
            for name, node in reversed(self._config.nodes.items()):
                if name == "drive":
                    self._send(setup.NMT, bytes((setup.STOP_NODE, node.node_id)))
                self._send(setup.NMT, bytes((setup.PRE_OPERATIONAL, node.node_id)))
        self._master = False
        with contextlib.suppress(can.CanError, OSError):
            self._bus.shutdown()

    def _pdos(self) -> dict[str, list[PdoCodec]]:
        """Return the process data objects to map, by device."""
        encoder, force, drive = self._parts
        pdos: dict[str, list[PdoCodec]] = {}
        if encoder is not None and self._config.encoder is not None:
            pdos["encoder"] = [encoder.codec]
        if force is not None and self._config.force_sensor is not None:
            pdos["force sensor"] = [force.codec]
        if drive is not None:
            pdos["drive"] = [drive.rpdo, drive.tpdo]
            pdos["drive"] += [] if self._switch is None else [self._switch]
            if force is not None and self._config.force == FROM_INPUT:
                pdos["drive"].append(force.codec)
        return pdos

    def _ask(self) -> None:
        """Send a SYNC that the receiver does not know of yet."""
        self._receiver.asked()
        self._send_sync()

    def _send_sync(self) -> None:
        """Send SYNC and note its time: the answers will be stamped with it."""
        count = self._sync_words[COUNT]
        self._note_sync(self._now_ns())
        self._send(self._sync_id, bytes((count,)) if count else b"")

    def _send(self, can_id: int, data: bytes) -> None:
        """Send without waiting; a frame that cannot be sent is counted."""
        try:
            self._send_frame(can_id, data)
        except (can.CanError, OSError) as error:
            self.counters["send_failed"] += 1
            self._send_failures += 1
            if self._send_failures == SEND_FAILURES_FAULT:
                self._receiver.raise_fault(send_fault(error))
                purge(self._bus)
        else:
            self._send_failures = 0
