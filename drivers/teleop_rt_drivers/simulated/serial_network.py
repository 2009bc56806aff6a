"""The serial side of the simulated rig: one device on each line."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from teleop_rt.axis import AxisError
from teleop_rt_drivers.framed.stream import DescriptorStream, StreamGoneError
from teleop_rt_drivers.simulated import frame_devices as devices
from teleop_rt_drivers.simulated.byte_faults import BYTE_FAULTS, FaultyFrames
from teleop_rt_drivers.simulated.faults import break_drive
from teleop_rt_drivers.simulated.frame_devices import FramedServo, Sensor
from teleop_rt_drivers.simulated.servo import ForceServo, PlainServo
from teleop_rt_drivers.simulated.slow_converter import SlowConverter

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from teleop_rt_drivers.framed.config import SerialPart
    from teleop_rt_drivers.framed.stream import ByteStream
    from teleop_rt_drivers.simulated.frame_devices import FrameDevice
    from teleop_rt_drivers.simulated.plant import Plant

    MakeDevice = Callable[[Plant, FaultyFrames, int], FrameDevice]


def _sensor(
    name: str, encoder: Callable[[Plant], Callable[[int], bytes]], banner: bytes = b""
) -> MakeDevice:
    return lambda plant, faults, period_ns: Sensor(name, encoder(plant), period_ns, faults, banner)


def _drive(plant: Plant, faults: FaultyFrames, period_ns: int) -> FrameDevice:
    servo = PlainServo(plant, period_ns)
    return FramedServo(servo, devices.drive_commands, devices.drive_answer(), faults)


def _force_drive(plant: Plant, faults: FaultyFrames, period_ns: int) -> FrameDevice:
    servo = ForceServo(plant, period_ns)
    commands = partial(devices.drive_commands, sync=0xC4)
    return FramedServo(servo, commands, devices.drive_answer(b"\x3d"), faults)


SLOW_SEED = 711
"""Of the slow converter's jitter, which is the same for all seeds of a trial."""
SIMULATED: dict[str, MakeDevice] = {
    "wrench_crc16": _sensor("force sensor", devices.wrench),
    "counts_55aa": _sensor("force sensor", devices.counts),
    "converter_24bit": _sensor("force sensor", devices.converter),
    "hx711_text": lambda plant, faults, _: SlowConverter(plant, faults, SLOW_SEED),
    "load_cell_text": _sensor("force sensor", devices.load_cell, b"load cell 1.0\r\n"),
    "quadrature_counter": _sensor("encoder", devices.quadrature),
    "position_drive_answer": _drive,
    "force_drive_answer": _force_drive,
}
"""Which device speaks a format."""


NO_DESCRIPTOR = -1
"""In place of a stream's descriptor where it is in this process."""


def _descriptor_of(stream: ByteStream) -> int:
    return stream.descriptor if isinstance(stream, DescriptorStream) else NO_DESCRIPTOR


class SerialNetwork:
    """The devices of a serial rig, each at its stream."""

    def __init__(
        self,
        config: SerialPart,
        plant: Plant,
        streams: dict[str, ByteStream],
        now_ns: Callable[[], int],
        period_ns: int,
        seed: int,
        latched: Callable[[], None],
    ) -> None:
        self.lost_frames = 0
        self.drive: FramedServo | None = None
        self.devices: dict[str, FrameDevice] = {}
        self._plant = plant
        self._streams: dict[str, ByteStream] = {}
        self._now_ns = now_ns
        self._latched = latched
        for number, (name, port) in enumerate(config.ports.items()):
            if port.format not in SIMULATED:
                raise AxisError(
                    f"ports.{name}: no simulated device sends {port.format!r}; "
                    f"one of: {', '.join(SIMULATED)}"
                )
            faults = FaultyFrames(self._sender(streams[name]), seed + number)
            device = SIMULATED[port.format](plant, faults, period_ns)
            self.devices[device.name] = device
            self._streams[device.name] = streams[name]
            if isinstance(device, FramedServo):
                self.drive = device
        self._unplugged: list[FrameDevice] = []
        self._items: list[tuple[FrameDevice, ByteStream, int]] = []
        self._descriptors: list[int] = []
        self._serve(list(self.devices))

    def power_on(self) -> None:
        """Switch every device on."""
        for device in self.devices.values():
            device.power_on()

    def inject(self, fault: str, device: str) -> bool:
        """Inject a fault by name; false where there is no such fault on a serial line."""
        if fault == "unplug":
            self._streams[device].close()
            served = [one.name for one, *_ in self._items]
            self._serve([name for name in served if name != device])
            self.devices[device].faults.fault = "mute"
            self._unplugged.append(self.devices[device])
            return True
        if fault == "reset":
            self.devices[device].reset()
            return True
        if fault in BYTE_FAULTS:
            self.devices[device].faults.fault = fault
            return True
        return break_drive(fault, self.drive)

    def heal(self, device: str) -> None:
        """End the device's lasting fault."""
        self.devices[device].faults.heal()

    def process(self) -> None:
        """Handle the waiting frames, as of now, and let the devices send those that are due."""
        self.serve_once(self.descriptors())

    def serve_once(self, readable: Collection[int]) -> None:
        """Do the same, without a look at lines that are not among the readable ones."""
        now_ns = self._now_ns()
        self._plant.advance(now_ns)
        measured = False
        for device, stream, descriptor in self._items:
            if descriptor == NO_DESCRIPTOR or descriptor in readable:
                try:
                    data = stream.read()
                except StreamGoneError:
                    continue
                if data:
                    device.receive(data, now_ns)
            measured = device.run(now_ns) or measured
        for device in self._unplugged:  # goes on by itself, heard by nobody
            device.run(now_ns)
        if measured:
            self._latched()

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""
        return min([device.due_ns(now_ns) for device, *_ in self._items], default=now_ns)

    def descriptors(self) -> list[int]:
        """Return the descriptor that becomes readable when there is something to do."""
        return self._descriptors

    def close(self) -> None:
        """Release the lines."""
        for _, stream, _ in self._items:
            stream.close()
        self._serve([])

    def _serve(self, names: list[str]) -> None:
        """Serve the lines of these devices from now on."""
        streams = self._streams
        self._items = [
            (self.devices[name], streams[name], _descriptor_of(streams[name])) for name in names
        ]
        self._descriptors = [one for *_, one in self._items if one != NO_DESCRIPTOR]

    def _sender(self, stream: ByteStream) -> Callable[[bytes], None]:
        def send(data: bytes) -> None:
            try:
                if not stream.write(data):
                    self.lost_frames += 1
            except StreamGoneError:
                self.lost_frames += 1

        return send
