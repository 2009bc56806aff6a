"""Simulated drives with protocols of their makers: the part of every wire, and CAN's."""

from __future__ import annotations

import struct
from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, Protocol

import can

from teleop_rt_drivers.actuators.part import ActuatorPart
from teleop_rt_drivers.simulated.byte_faults import BYTE_FAULTS, FaultyFrames
from teleop_rt_drivers.simulated.faults import BUS_OFF_CLASS, break_bus, break_drive, mend_bus
from teleop_rt_drivers.simulated.mit_motors import simulated_motor
from teleop_rt_drivers.simulated.moteus import SimulatedMoteus
from teleop_rt_drivers.simulated.odrive import SimulatedOdrive
from teleop_rt_drivers.simulated.plant import Plant
from teleop_rt_drivers.simulated.vesc import SimulatedVesc

if TYPE_CHECKING:
    from collections.abc import Mapping

Send = Callable[[int, bytes], None]

EXTENDED, WIDE = 0x8000_0000, 0x4000_0000
"""Marks of an id as the frames' faults see it: 29 bits long, CAN FD."""
FRAME_FAULTS = ("wrong_id", "swapped_bytes")


class Actuator(Protocol):
    """A simulated drive, whatever its wire."""

    refuses: bool
    position_at: int
    """Place of the position in its report."""
    other_id: int
    """Bit of its id that makes it another drive's."""

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""

    def restart(self) -> None:
        """Be as after power-on."""

    def run(self, now_ns: int) -> bool:
        """Do the due work; return whether a measurement was sent."""

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""

    def overheat(self) -> None:
        """Fail for being too hot."""


class CanDrive(Actuator, Protocol):
    """A simulated drive on a CAN bus."""

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Take a frame."""


SIMULATED: dict[str, Callable[[ActuatorPart, Plant, Send, int], CanDrive]] = {
    "odrive": SimulatedOdrive,
    "mit_can": simulated_motor,
    "moteus": SimulatedMoteus,
    "vesc": SimulatedVesc,
}
"""Which device answers a driver on a CAN bus."""


class ActuatorNetwork:
    """One drive, alone on its wire; a subclass names the wire."""

    def __init__(
        self,
        config: ActuatorPart,
        plant: Plant,
        drive: Actuator,
        now_ns: Callable[[], int],
        seed: int,
        latched: Callable[[], None],
    ) -> None:
        self.lost_frames = 0
        self.drive = drive
        self.faults = FaultyFrames(self._transmit, seed)
        self._frame_fault = ""
        self._off = False
        self._plant = plant
        self._now_ns = now_ns
        self._latched = latched
        gives = ["drive"]
        gives += ["encoder"] if config.position else []
        gives += ["force sensor"] if config.force else []
        self.devices: Mapping[str, Actuator] = dict.fromkeys(gives, self.drive)

    def power_on(self) -> None:
        """Switch the drive on."""
        self.drive.restart()

    def inject(self, fault: str, device: str) -> bool:  # noqa: ARG002 - there is but one
        """Inject a fault by name; false where this network knows no such fault."""
        if fault == "reset":
            self.drive.restart()
        elif fault in BYTE_FAULTS:
            self.faults.fault = fault
        elif fault in FRAME_FAULTS:
            self._frame_fault = fault
        elif self._broken(fault):
            self._off = True
        else:
            return break_drive(fault, self.drive)
        return True

    def heal(self, device: str) -> None:  # noqa: ARG002 - as above
        """End the lasting fault."""
        self.faults.heal()
        self._frame_fault = ""
        if self._off:
            self._off = False
            self.power_on()
            self._mend()

    def process(self) -> None:
        """Handle the waiting frames, as of now, and let the drive send the frames that are due."""
        now_ns = self._now_ns()
        self._plant.advance(now_ns)
        self._receive(now_ns)
        self.drive.run(now_ns)
        self._latched()  # those that answer measure when they are asked

    def serve_once(self, readable: Collection[int]) -> None:  # noqa: ARG002 - there is one bus
        """Handle the waiting frames, as of now."""
        self.process()

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""
        return self.drive.due_ns(now_ns)

    def _spoilt(self, whom: int, data: bytes) -> tuple[int, bytes]:
        """Return id and content of a frame, as its fault changes them."""
        if self._frame_fault == "wrong_id":
            return whom ^ self.drive.other_id, data
        if self._frame_fault == "swapped_bytes":
            place = self.drive.position_at
            return whom, data[:place] + data[place : place + 2][::-1] + data[place + 2 :]
        return whom, data

    def _broken(self, fault: str) -> bool:
        """Cut the wire; false where the fault is another."""
        raise NotImplementedError

    def _mend(self) -> None:
        """Join the wire again."""
        raise NotImplementedError

    def _receive(self, now_ns: int) -> None:
        """Let the drive take the arrived frames."""
        raise NotImplementedError

    def _transmit(self, packed: bytes) -> None:
        """Put the rest that the faults left of a frame on the wire."""
        raise NotImplementedError


class CanActuatorNetwork(ActuatorNetwork):
    """One drive, alone on its CAN bus."""

    drive: CanDrive

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
        self._bus = bus
        drive = SIMULATED[config.driver](config, plant, self._send, period_ns)
        super().__init__(config, plant, drive, now_ns, seed, latched)

    def _broken(self, fault: str) -> bool:
        if fault != "bus_off":
            return break_bus(fault, self._bus)
        self._bus.send(
            can.Message(
                arbitration_id=BUS_OFF_CLASS,
                is_extended_id=False,
                is_error_frame=True,
                data=bytes(8),
            )
        )
        return True

    def _mend(self) -> None:
        mend_bus(self._bus)

    def _receive(self, now_ns: int) -> None:
        while (frame := self._next()) is not None:
            if not self._off:
                self.drive.receive(frame.arbitration_id, bytes(frame.data), now_ns)

    def _next(self) -> can.Message | None:
        try:
            return self._bus.recv(0)
        except (can.CanError, OSError, ValueError):
            return None

    def descriptors(self) -> list[int]:
        """Return the descriptor that becomes readable when there is something to do."""
        return [self._bus.fileno()]

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def _send(self, can_id: int, data: bytes) -> None:
        can_id, data = self._spoilt(can_id, data)
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
