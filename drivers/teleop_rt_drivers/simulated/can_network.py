"""The raw-CAN side of the simulated rig: devices whose messages `dbc/simulated_rig.dbc` describes.

Their bytes are made by hand here, so that the DBC and its reading are tested by them.
"""

from __future__ import annotations

import struct
from functools import partial
from typing import TYPE_CHECKING

import can

from teleop_rt_drivers.simulated.byte_faults import BYTE_FAULTS, FaultyFrames
from teleop_rt_drivers.simulated.faults import BUS_OFF_CLASS, break_bus, break_drive, mend_bus
from teleop_rt_drivers.simulated.frame_devices import FramedServo, Sensor, clamped, crc8
from teleop_rt_drivers.simulated.line_frames import INT32, device_time_us
from teleop_rt_drivers.simulated.servo import PlainServo

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from teleop_rt_drivers.framed.config import RawCanPart
    from teleop_rt_drivers.simulated.frame_devices import FrameDevice
    from teleop_rt_drivers.simulated.plant import Plant

ENCODER_ID, FORCE_ID, STATUS_ID, COMMAND_ID = 0x100, 0x101, 0x102, 0x103  # as in the DBC


class CanNetwork:
    """Encoder, force sensor and drive with messages of their own, those that the config has."""

    def __init__(
        self,
        config: RawCanPart,
        plant: Plant,
        bus: can.BusABC,
        now_ns: Callable[[], int],
        period_ns: int,
        seed: int,
        latched: Callable[[], None],
    ) -> None:
        self.lost_frames = 0
        self.drive: FramedServo | None = None
        self.devices: dict[str, FrameDevice] = {}
        self._off = False
        self._plant = plant
        self._bus = bus
        self._now_ns = now_ns
        self._latched = latched
        if config.position is not None:
            self._add(Sensor("encoder", _encoder(plant), period_ns, self._faults(ENCODER_ID, seed)))
        if config.force is not None:
            faults = self._faults(FORCE_ID, seed + 1)
            self._add(Sensor("force sensor", _force(plant), period_ns, faults))
        if config.drive is not None:
            faults = self._faults(STATUS_ID, seed + 2)
            self.drive = FramedServo(PlainServo(plant, period_ns), _command, _status(), faults)
            self._add(self.drive)

    def power_on(self) -> None:
        """Switch every device on."""
        for device in self.devices.values():
            device.power_on()

    def inject(self, fault: str, device: str) -> bool:
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
            self.devices[device].reset()
        elif fault in BYTE_FAULTS:
            self.devices[device].faults.fault = fault
        elif break_bus(fault, self._bus):
            self._off = True
        else:
            return break_drive(fault, self.drive)
        return True

    def heal(self, device: str) -> None:
        """End the device's lasting fault."""
        self.devices[device].faults.heal()
        if self._off:
            self._off = False
            self.power_on()
            mend_bus(self._bus)

    def process(self) -> None:
        """Handle the waiting frames, as of now, and let the devices send those that are due."""
        now_ns = self._now_ns()
        self._plant.advance(now_ns)
        while (frame := self._receive()) is not None:
            if frame.arbitration_id == COMMAND_ID and self.drive is not None and not self._off:
                self.drive.receive(bytes(frame.data), now_ns)
        measured = False
        for device in self.devices.values():
            measured = device.run(now_ns) or measured
        if measured:
            self._latched()

    def serve_once(self, readable: Collection[int]) -> None:  # noqa: ARG002 - there is one bus
        """Handle the waiting frames, as of now."""
        self.process()

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""
        return min(device.due_ns(now_ns) for device in self.devices.values())

    def descriptors(self) -> list[int]:
        """Return the descriptor that becomes readable when there is something to do."""
        return [self._bus.fileno()]

    def close(self) -> None:
        """Release the bus."""
        self._bus.shutdown()

    def _add(self, device: FrameDevice) -> None:
        self.devices[device.name] = device

    def _faults(self, can_id: int, seed: int) -> FaultyFrames:
        return FaultyFrames(partial(self._send, can_id), seed)

    def _receive(self) -> can.Message | None:
        try:
            return self._bus.recv(0)
        except (can.CanError, OSError, ValueError):
            return None

    def _send(self, can_id: int, data: bytes) -> None:
        """Send a frame; one that the bus does not take is lost, as on a wire."""
        if self._off:
            return
        try:
            self._bus.send(can.Message(arbitration_id=can_id, is_extended_id=False, data=data[:8]))
        except can.CanError:
            self.lost_frames += 1


def _checked(body: bytes) -> bytes:
    return body + bytes((crc8(body),))


def _encoder(plant: Plant) -> Callable[[int], bytes]:
    count = 0

    def encode(now_ns: int) -> bytes:
        nonlocal count
        count = (count + 1) & 0x0F
        steps = clamped(plant.encoder_counts, INT32)
        ticks = device_time_us(now_ns) // 10 & 0xFFFF
        return _checked(struct.pack("<iBH", steps, count, ticks))

    return encode


def _force(plant: Plant) -> Callable[[int], bytes]:
    count = 0

    def encode(_: int) -> bytes:
        nonlocal count
        count = (count + 1) & 0x0F
        return _checked(
            struct.pack(">iBBx", clamped(1000.0 * plant.measured_force(), INT32), 0, count)
        )

    return encode


def _command(data: bytes) -> list[tuple[int, int]]:
    """Return control and target of a good command."""
    if len(data) != 8 or crc8(data[:7]) != data[7]:
        return []
    target, control = struct.unpack("<iB", data[:5])
    return [(control & 3, target)]


def _status() -> Callable[[PlainServo], bytes]:
    count = 0

    def encode(servo: PlainServo) -> bytes:
        nonlocal count
        count = (count + 1) & 0x0F
        return _checked(struct.pack("<iBBx", clamped(servo.actual, INT32), servo.state, count))

    return encode
