"""When the devices on serial lines answer by one kernel, and their state in Python after."""

from __future__ import annotations

import select
import time
from io import FileIO
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from teleop_rt.kernels.jit import bound
from teleop_rt.realtime.system_calls import EVENT_WORDS, TIMER_WORDS, new_timer
from teleop_rt.signals import TRUTH
from teleop_rt_drivers.framed.stream import READ_BYTES, DescriptorStream
from teleop_rt_drivers.simulated import line_answer as kernels
from teleop_rt_drivers.simulated.frame_devices import FramedServo, Sensor
from teleop_rt_drivers.simulated.line_answer import LINES_DRIVE, SENSOR, Lines
from teleop_rt_drivers.simulated.line_frames import LONGEST, WRENCH
from teleop_rt_drivers.simulated.senses import DRAWS, MOST_ROWS, TrueRows

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from teleop_rt_drivers.framed.stream import ByteStream
    from teleop_rt_drivers.simulated.frame_devices import FrameDevice
    from teleop_rt_drivers.simulated.hidden_motion import Matrix
    from teleop_rt_drivers.simulated.line_answer import DriveFields
    from teleop_rt_drivers.simulated.plant import Plant


class LineAnswering:
    """Sends and answers the frames of every cycle on lines, while nothing else happens to them.

    Between `begin` and `end` a kernel has the devices' state. `lines` are its arrays, with which
    another kernel may send the sensors' frames, too, where `drive` is None: it waits for `timer`,
    the descriptor that is readable when one is due. Once a line is pulled,
    `plugged` is false, and no kernel has its turn any more.
    """

    def __init__(self, items: Sequence[tuple[FrameDevice, DescriptorStream]], plant: Plant) -> None:
        self._plant, self.plugged = plant, True
        self._sensors = [one for one, _ in items if isinstance(one, Sensor)]
        self.drive = next((one for one, _ in items if isinstance(one, FramedServo)), None)
        descriptors = {one.name: stream.descriptor for one, stream in items}
        drive = np.zeros(1, LINES_DRIVE)
        self._fields = cast("DriveFields", drive[0])
        sensors = np.zeros(len(self._sensors), SENSOR)
        self._due_ns, self._lost = sensors["due_ns"], drive["lost"]
        self.lines = Lines(
            sensors=sensors,
            drive=drive,
            frames=np.zeros((len(self._sensors) + 1, LONGEST), np.uint8),
            memory=np.zeros(READ_BYTES, np.uint8),
            clock=np.zeros(2, np.int64),
            event=np.zeros(EVENT_WORDS, np.uint32),
            ring=np.zeros(TIMER_WORDS, np.int64),
        )
        self._fields.memory = self.lines.memory.ctypes.data
        self._fields.clock = self.lines.clock.ctypes.data
        self._fields.event = self.lines.event.ctypes.data
        self._fields.ring = self.lines.ring.ctypes.data
        self._timer = FileIO(new_timer())
        self.timer = self._fields.timer = self._timer.fileno()
        for row, sensor in enumerate(self._sensors):
            self._place_sensor(row, sensor, descriptors[sensor.name])
        if self.drive is not None:
            self._place_drive(self.drive, descriptors[self.drive.name])
        self.samples = int(np.count_nonzero(sensors["kind"] == WRENCH))
        self._fields.samples = self.samples
        self._true = TrueRows(np.zeros((MOST_ROWS, len(TRUTH))), np.zeros(1, np.int64))
        self._watched: list[int] = []
        if self.drive is not None:
            self._epoll = select.epoll()
            edges = kernels.FOR_DRIVE | select.EPOLLET
            self._epoll.register(descriptors[self.drive.name], edges)
            self._epoll.register(self.timer, select.EPOLLIN)
            arrays = self.lines, plant.moving, plant.beside, self._true
            # Compiled now, so that the first command is answered in time.
            self._answer = bound(kernels.answer_lines, arrays, 0, 0)

    def _place_sensor(self, row: int, sensor: Sensor, descriptor: int) -> None:
        """Give the kernel a sensor's frame, line and grid."""
        fields: Any = self.lines.sensors[row]
        fields.place, fields.length = self._move(row, sensor)
        fields.descriptor, fields.kind = descriptor, sensor.written.kind if sensor.written else 0
        fields.period_ns = sensor.period_ns
        reads = self._plant.config.sensors
        fields.zero, fields.step = reads.encoder_zero, reads.encoder_resolution

    def _place_drive(self, servo: FramedServo, descriptor: int) -> None:
        """Give the kernel the drive's answer, line and counts."""
        fields, drive = self._fields, self._plant.config.drive
        fields.place, _ = self._move(len(self._sensors), servo)
        fields.descriptor, fields.period_s = descriptor, servo.servo.period_s
        fields.zero, fields.step = drive.zero, drive.position_resolution

    def _move(self, row: int, device: Sensor | FramedServo) -> tuple[int, int]:
        """Let a device's frame be a row of the kernel's; return its address and length."""
        written = device.written
        assert written is not None  # noqa: S101 - `can_answer`
        frame = self.lines.frames[row, : written.data.size]
        frame[:] = written.data
        written.move_to(frame)
        return frame.ctypes.data, frame.size

    def _watch(self, descriptors: list[int]) -> None:
        """Wait for these from now on, too; one that is readable ends it."""
        for one in self._watched:
            self._epoll.unregister(one)
        for one in descriptors:
            self._epoll.register(one, select.EPOLLIN)
        self._watched = descriptors

    def begin(self) -> bool:
        """Give the kernel the devices as they stand; return whether it may answer for them."""
        faults = any(one.faults.fault for one in self._sensors)
        usual = self.plugged and not faults and self._begin_drive()
        for row, sensor in enumerate(self._sensors):
            self._due_ns[row] = sensor.next_ns if usual else kernels.NEVER_NS
        if self.samples:
            self._plant.draw(DRAWS)
        return usual

    def _begin_drive(self) -> bool:
        """Give the kernel the drive as it stands, if there is one; return whether that can be."""
        if self.drive is None:
            return True
        standing = None if self.drive.faults.fault else self.drive.servo.standing()
        if standing is None:
            return False
        self._fields.control, self._fields.state, self._fields.heard_ns = standing
        return True

    def end(self) -> int:
        """Take the devices' state back; return how many frames no line took."""
        for row, sensor in enumerate(self._sensors):
            sensor.next_ns = self._due_ns.item(row)
        if self.drive is not None:
            self.drive.servo.resume(self._fields.heard_ns)
        lost: int = self._lost.item(0)
        self._lost[0] = 0
        return lost

    def answer_until(self, until_ns: int, descriptors: list[int]) -> bytes:
        """Answer until then, after `begin`, or until one of these descriptors is readable.

        There is a drive. Return other bytes that it received, if any.
        """
        if descriptors != self._watched:
            self._watch(descriptors)
        happened = self._answer(self._epoll.fileno(), until_ns)
        strange = happened == kernels.STRANGE
        return self.lines.memory[: max(0, self._fields.received)].tobytes() if strange else b""

    def close(self) -> None:
        """Release timer and epoll."""
        self._timer.close()
        if self.drive is not None:
            self._epoll.close()

    def new_rows(self) -> Matrix:
        """Return the rows of true motion (n, columns) since the last call, until the next run."""
        rows = self._true.rows[: self._true.new.item(0)]
        self._true.new[0] = 0
        return rows


def line_answering(
    items: Sequence[tuple[FrameDevice, ByteStream]], plant: Plant, now_ns: Callable[[], int]
) -> LineAnswering | None:
    """Return the kernel's part for these devices; None where it does not know one of them."""
    if now_ns is not time.monotonic_ns or not plant.answers:
        return None
    on_lines = [(one, line) for one, line in items if isinstance(line, DescriptorStream)]
    known = [
        one
        for one, _ in on_lines
        if isinstance(one, Sensor | FramedServo) and one.written is not None
    ]
    return LineAnswering(on_lines, plant) if len(known) == len(items) else None
