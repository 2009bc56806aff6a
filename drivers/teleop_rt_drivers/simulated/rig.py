"""The simulated rig: plant and devices on a bus, in lock-step or as a process of its own."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Literal

import can
import numpy as np

from teleop_rt.signals import TRUTH
from teleop_rt_drivers.simulated.devices import Encoder, ForceSensor
from teleop_rt_drivers.simulated.drive import ServoDrive
from teleop_rt_drivers.simulated.faults import LASTING, SINGLE, FaultyWire
from teleop_rt_drivers.simulated.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from teleop_rt.config import RigConfig
    from teleop_rt_drivers.canopen.config import CanopenConfig
    from teleop_rt_drivers.simulated.config import SimulatedPlantConfig
    from teleop_rt_drivers.simulated.device import Device
    from teleop_rt_drivers.simulated.faults import LastingFault, SingleFault

    DeviceName = Literal["encoder", "force sensor", "drive"]

NMT, HEARTBEAT, SDO_REQUEST = 0x000, 0x700, 0x600
IDLE_ADVANCE_NS = 5_000_000
"""Without SYNC the plant still runs on, in spans of this length."""
SERVE_WAIT_S = 0.005
LONGEST_WAIT_NS = 50_000_000
"""A frame that seems to have waited longer tells of a wall clock that was set, not of waiting."""
HARDWARE_FAULT = 0x5000


class SimulatedRig:
    """Encoder, force sensor and drive as CANopen nodes around one plant.

    `truth_row` holds the newest row of `teleop_rt.signals.TRUTH`, of the last SYNC; `on_truth`,
    if set, is called after each. All stamps come from `now_ns`, all random numbers from `seed`.
    """

    def __init__(
        self,
        plant: SimulatedPlantConfig,
        rig: RigConfig,
        axis: CanopenConfig,
        bus: can.BusABC,
        now_ns: Callable[[], int],
        seed: int,
    ) -> None:
        self.plant = Plant(plant, now_ns(), seed)
        self.truth_row: NDArray[np.float64] = np.zeros(len(TRUTH))
        self.on_truth: Callable[[], None] | None = None
        self.lost_frames = 0
        self._units = rig.units
        self._bus = bus
        self._now_ns = now_ns
        self._sync_cob_id = axis.daemon.sync_cob_id
        self._wire = FaultyWire(self._transmit, seed)
        send = self._wire.send
        self.drive = ServoDrive(axis.drive, send, self.plant)
        self.devices: dict[str, Device] = {
            "encoder": Encoder(axis.encoder, send, self.plant),
            "force sensor": ForceSensor(axis.force, send, self.plant),
            "drive": self.drive,
        }
        self._by_node = {device.node_id: device for device in self.devices.values()}
        self._nodes = tuple(self._by_node.values())
        self._note_truth()

    def power_on(self) -> None:
        """Boot every device."""
        for device in self._nodes:
            device.boot()

    def inject(
        self, fault: LastingFault | SingleFault, device: DeviceName = "force sensor"
    ) -> None:
        """Inject a fault by name; a lasting one stays until `heal`."""
        node = self.devices[device]
        if fault == "reset":
            node.boot()
        elif fault == "emergency":
            node.emergency(HARDWARE_FAULT)
        elif fault == "bus_off":
            self._wire.bus_off()
        elif fault in LASTING:
            self._wire.inject(fault, node.node_id)
        else:
            raise ValueError(f"unknown fault {fault!r}; one of: {', '.join((*LASTING, *SINGLE))}")

    def heal(self, device: DeviceName) -> None:
        """End the device's lasting fault."""
        self._wire.heal(self.devices[device].node_id)

    def process(self) -> None:
        """Handle the frames that wait, run the devices' timers, let the plant run on."""
        while (message := self._bus.recv(0)) is not None:
            self._handle(message, self._now_ns())
        self._run_timers(self._now_ns())

    def serve(self, stop: Callable[[], bool]) -> None:
        """Answer on the bus until `stop()`; frames count from when the kernel received them."""
        self.power_on()
        while not stop():
            message = self._receive(SERVE_WAIT_S)
            while message is not None:
                age_ns = time.time_ns() - round(message.timestamp * 1e9)
                self._handle(message, self._now_ns() - min(max(0, age_ns), LONGEST_WAIT_NS))
                message = self._receive(0)
            self._run_timers(self._now_ns())

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def truth(self) -> dict[str, Any]:
        """Return what only the plant knows, for truth.json; the rig's units are with it."""
        return {"units": self._units.model_dump(), **self.plant.truth()}

    def _receive(self, timeout_s: float) -> can.Message | None:
        """Return the next readable frame, or None."""
        try:
            return self._bus.recv(timeout_s)
        except (can.CanError, OSError, ValueError):
            return None

    def _transmit(self, message: can.Message) -> None:
        """Send a device's frame; one that the bus does not take is lost, as on a wire."""
        try:
            self._bus.send(message)
        except can.CanError:
            self.lost_frames += 1

    def _handle(self, message: can.Message, stamp_ns: int) -> None:
        """Give a frame to the devices that it is for."""
        if self._wire.off or message.is_error_frame or message.is_extended_id:
            return
        cob_id, data = message.arbitration_id, bytes(message.data)
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
            for device in self._nodes:
                device.receive_pdo(cob_id, data)

    def _sync(self, stamp_ns: int) -> None:
        """Latch the plant at the time of SYNC, act on commands, send the answers."""
        self.plant.advance(stamp_ns)
        for device in self._nodes:
            device.sync()
        self._note_truth()

    def _network_management(self, data: bytes) -> None:
        if len(data) != 2:
            return
        for device in self._nodes:
            if data[1] in (0, device.node_id):
                device.receive_nmt(data[0])

    def _run_timers(self, now_ns: int) -> None:
        if now_ns - self.plant.now_ns > IDLE_ADVANCE_NS:
            self.plant.advance(now_ns)
        for device in self._nodes:
            device.run_timers(now_ns)

    def _note_truth(self) -> None:
        plant = self.plant
        self.truth_row[:] = (
            plant.now_ns,
            plant.position,
            plant.velocity,
            plant.force,
            plant.reference,
        )
        if self.on_truth is not None:
            self.on_truth()
