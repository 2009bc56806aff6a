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
from teleop_rt_drivers.simulated.line_answering import line_answering
from teleop_rt_drivers.simulated.line_frames import DRIVE, EDGES, WRENCH, WrittenFrame
from teleop_rt_drivers.simulated.senses import LONGEST_ANSWERING_NS
from teleop_rt_drivers.simulated.servo import ForceServo, PlainServo
from teleop_rt_drivers.simulated.slow_converter import SlowConverter

if TYPE_CHECKING:
    from collections.abc import Callable, Collection

    from teleop_rt_drivers.framed.config import SerialPart
    from teleop_rt_drivers.framed.stream import ByteStream
    from teleop_rt_drivers.simulated.frame_devices import FrameDevice
    from teleop_rt_drivers.simulated.hidden_motion import Matrix
    from teleop_rt_drivers.simulated.plant import Plant
    from teleop_rt_drivers.simulated.rig import Network

    MakeDevice = Callable[[Plant, FaultyFrames, int], FrameDevice]


def _sensor(
    name: str, encoder: Callable[[Plant], Callable[[int], bytes]], banner: bytes = b""
) -> MakeDevice:
    return lambda plant, faults, period_ns: Sensor(name, encoder(plant), period_ns, faults, banner)


def _written(name: str, kind: int, read: Callable[[Plant], float]) -> MakeDevice:
    """Return the maker of a sensor whose frames a kernel writes."""

    def make(plant: Plant, faults: FaultyFrames, period_ns: int) -> FrameDevice:
        written = WrittenFrame(kind)

        def encode(now_ns: int) -> bytes:
            return written.of(read(plant), now_ns=now_ns)

        return Sensor(name, encode, period_ns, faults, written=written)

    return make


def _drive(plant: Plant, faults: FaultyFrames, period_ns: int) -> FrameDevice:
    servo, written = PlainServo(plant, period_ns), WrittenFrame(DRIVE)
    return FramedServo(servo, devices.drive_commands, _answer(written), faults, written)


def _force_drive(plant: Plant, faults: FaultyFrames, period_ns: int) -> FrameDevice:
    servo = ForceServo(plant, period_ns)
    commands = partial(devices.drive_commands, sync=0xC4)
    return FramedServo(servo, commands, _answer(WrittenFrame(DRIVE, b"\x3d")), faults)


def _answer(written: WrittenFrame) -> Callable[[PlainServo], bytes]:
    return lambda servo: written.of(servo.actual, servo.state)


SLOW_SEED = 711
"""Of the slow converter's jitter, which is the same for all seeds of a trial."""
SIMULATED: dict[str, MakeDevice] = {
    "wrench_crc16": _written("force sensor", WRENCH, lambda plant: plant.measured_force()),
    "counts_55aa": _sensor("force sensor", devices.counts),
    "converter_24bit": _sensor("force sensor", devices.converter),
    "hx711_text": lambda plant, faults, _: SlowConverter(plant, faults, SLOW_SEED),
    "load_cell_text": _sensor("force sensor", devices.load_cell, b"load cell 1.0\r\n"),
    "quadrature_counter": _written("encoder", EDGES, lambda plant: plant.encoder_counts),
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
        note: Callable[[Matrix], None],
    ) -> None:
        self.lost_frames = 0
        self.drive: FramedServo | None = None
        self.devices: dict[str, FrameDevice] = {}
        self._plant = plant
        self._streams: dict[str, ByteStream] = {}
        self._now_ns = now_ns
        self._latched, self._note = latched, note
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
        served = [(device, stream) for device, stream, _ in self._items]
        self.answering = line_answering(served, plant, now_ns)

    @property
    def together(self) -> tuple[Network, ...]:
        """The networks whose frames a kernel answers, if they do nothing else."""
        return (self,)

    def begin(self) -> bool:
        """Leave the sensors to a kernel; return whether it may send their frames."""
        return self.answering is not None and self.answering.begin()

    def end(self) -> None:
        """Take the devices back from a kernel."""
        if self.answering is not None:
            self.lost_frames += self.answering.end()

    def answer_until(self, until_ns: int, descriptors: list[int]) -> tuple[Network, ...]:
        """Handle the frames that come until then, or until one of these descriptors is readable.

        Lines of sensors are not looked at meanwhile: they ignore all bytes. Return the networks
        for which it did: none where devices do more than send measurements and answer the commands
        of every cycle.
        """
        answering, drive = self.answering, self.drive
        if answering is None or drive is None or not self.begin():
            return ()
        until_ns = min(until_ns, self._now_ns() + LONGEST_ANSWERING_NS)
        strange = answering.answer_until(until_ns, descriptors)
        self.end()
        self._note(answering.new_rows())
        now_ns = self._now_ns()
        self._plant.advance(now_ns)
        if strange:
            drive.receive(strange, now_ns)
        drive.run(now_ns)
        return (self,)

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
            if self.answering is not None:
                self.answering.plugged = False
            return True
        if fault == "reset":
            self.devices[device].reset()
            return True
        if fault in BYTE_FAULTS:
            self._break_frames(self.devices[device], fault)
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
        if self.answering is not None:
            self.answering.close()

    def _break_frames(self, device: FrameDevice, fault: str) -> None:
        """Inject a fault of a device's frames, of which a kernel may have sent the last."""
        written = getattr(device, "written", None)
        if written is not None:
            device.faults.note(written.data.tobytes())
        device.faults.fault = fault

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
