"""The bus of a simulated drive that speaks its maker's protocol."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import can

from teleop_rt_drivers.actuators.part import ActuatorPart
from teleop_rt_drivers.simulated.byte_faults import BYTE_FAULTS, FaultyFrames
from teleop_rt_drivers.simulated.can_network import BUS_OFF_CLASS
from teleop_rt_drivers.simulated.faults import break_bus, mend_bus
from teleop_rt_drivers.simulated.mit_motors import simulated_motor
from teleop_rt_drivers.simulated.moteus import SimulatedMoteus
from teleop_rt_drivers.simulated.odrive import SimulatedOdrive
from teleop_rt_drivers.simulated.plant import Plant

if TYPE_CHECKING:
    from collections.abc import Mapping

Send = Callable[[int, bytes], None]

EXTENDED, WIDE = 0x8000_0000, 0x4000_0000
"""Marks of an id as the frames' faults see it: 29 bits long, CAN FD."""
FRAME_FAULTS = ("wrong_id", "swapped_bytes")
DRIVE_FAULTS = ("refuse_enable", "over_temperature")


class Device(Protocol):
    """A simulated drive: bytes in, bytes out."""

    refuses: bool

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""

    def restart(self) -> None:
        """Be as after power-on."""

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Take a frame."""

    def run(self, now_ns: int) -> bool:
        """Do what is due; return whether a measurement was sent."""

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""

    def overheat(self) -> None:
        """Fail for being too hot."""


SIMULATED: dict[str, Callable[[ActuatorPart, Plant, Send, int], Device]] = {
    "odrive": SimulatedOdrive,
    "mit_can": simulated_motor,
    "moteus": SimulatedMoteus,
}
"""Which device answers a driver."""


class ActuatorNetwork:
    """One drive, alone on its bus."""

    def __init__(
        self,
        config: ActuatorPart,
        plant: Plant,
        bus: can.BusABC,
        now_ns: Callable[[], int],
        period_ns: int,
        seed: int,
        latched: Callable[[], None],
    ) -> None:
        self.lost_frames = 0
        self.faults = FaultyFrames(self._transmit, seed)
        self.drive: Device = SIMULATED[config.driver](config, plant, self._send, period_ns)
        self._frame_fault = ""
        self._off = False
        self._plant = plant
        self._bus = bus
        self._now_ns = now_ns
        self._latched = latched
        gives = ["drive"]
        gives += ["encoder"] if config.position else []
        gives += ["force sensor"] if config.force else []
        self.devices: Mapping[str, Device] = dict.fromkeys(gives, self.drive)

    def power_on(self) -> None:
        """Switch the drive on."""
        self.drive.restart()

    def inject(self, fault: str, device: str) -> bool:  # noqa: ARG002 - there is but one
        """Inject a fault by name; false where this network knows no such fault."""
        if fault == "bus_off":
            self._bus.send(
                can.Message(
                    arbitration_id=BUS_OFF_CLASS,
                    is_extended_id=False,
                    is_error_frame=True,
                    data=bytes(8),
                )
            )
            self._off = True
        elif fault == "reset":
            self.drive.restart()
        elif fault == "refuse_enable":
            self.drive.refuses = True
        elif fault == "over_temperature":
            self.drive.overheat()
        elif fault in BYTE_FAULTS:
            self.faults.fault = fault
        elif fault in FRAME_FAULTS:
            self._frame_fault = fault
        elif break_bus(fault, self._bus):
            self._off = True
        else:
            return False
        return True

    def heal(self, device: str) -> None:  # noqa: ARG002 - as above
        """End the lasting fault."""
        self.faults.heal()
        self._frame_fault = ""
        self.drive.refuses = False
        if self._off:
            self._off = False
            self.power_on()
            mend_bus(self._bus)

    def process(self) -> None:
        """Handle what waits, as of now, and let the drive send what is due."""
        now_ns = self._now_ns()
        self._plant.advance(now_ns)
        while (frame := self._receive()) is not None:
            if not self._off:
                self.drive.receive(frame.arbitration_id, bytes(frame.data), now_ns)
        if self.drive.run(now_ns):
            self._latched()

    serve_once = process

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""
        return self.drive.due_ns(now_ns)

    def descriptors(self) -> list[int]:
        """Return what becomes readable when there is something to do."""
        return [self._bus.fileno()]

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def _receive(self) -> can.Message | None:
        try:
            return self._bus.recv(0)
        except (can.CanError, OSError, ValueError):
            return None

    def _send(self, can_id: int, data: bytes) -> None:
        if self._frame_fault == "wrong_id":
            can_id ^= 0x100
        elif self._frame_fault == "swapped_bytes":
            data = data[1::-1] + data[2:]
        self.faults.send(struct.pack("<I", can_id) + data)

    def _transmit(self, packed: bytes) -> None:
        """Send a frame; one that the bus does not take is lost, as on a wire."""
        if self._off:
            return
        (marked,) = struct.unpack("<I", packed[:4].ljust(4, b"\0"))
        extended, wide = bool(marked & EXTENDED), bool(marked & WIDE)
        frame = can.Message(
            arbitration_id=marked & (0x1FFF_FFFF if extended else 0x7FF),
            is_extended_id=extended,
            is_fd=wide,
            bitrate_switch=wide,
            data=packed[4:] if wide else packed[4:12],
        )
        try:
            self._bus.send(frame)
        except can.CanError:
            self.lost_frames += 1
