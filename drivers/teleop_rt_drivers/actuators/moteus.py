"""moteus on CAN FD: registers written and read in one frame, each command with its own time-out.

Source: mjbots/moteus, docs/protocol/can.md and registers.md. An id is source << 8 | destination,
with bit 15 where an answer is wanted; a frame is a row of subframes, padded with NOP.
"""

from __future__ import annotations

import math
import struct

from teleop_rt_drivers.actuators.codec import AngleUnit, DriveState, Frame, Frames, Report, Taken

WRITE_INT8, WRITE_FLOAT, READ_INT8, READ_FLOAT, REPLY, ERRORS, NOP = (
    0x00, 0x0C, 0x10, 0x1C, 0x20, (0x30, 0x31), 0x50,
)  # fmt: skip
# Registers, and values of MODE, by moteus' reference of its registers.
MODE, POSITION, VELOCITY, TORQUE, FAULT, COMMAND = 0x000, 0x001, 0x002, 0x003, 0x00F, 0x020
STOPPED, FAULTED, POSITION_MODE, TIMED_OUT = 0, 1, 10, 11
ANSWER_WANTED = 0x8000  # bit of the id, by moteus' reference of its CAN format
FD_SIZES = (8, 12, 16, 20, 24, 32, 48, 64)  # bytes that a frame of CAN FD may have from 8 on
TYPES = (("b", 1), ("h", 2), ("i", 4), ("f", 4))  # of a register in a frame: format, bytes
STATES = {STOPPED: DriveState.OFF, POSITION_MODE: DriveState.FOLLOWING}
FAULT_WORDS = {
    32: "calibration", 33: "motor driver", 34: "over voltage", 35: "encoder",
    36: "motor not configured", 38: "over temperature", 39: "outside limit", 40: "under voltage",
    42: "theta invalid", 43: "position invalid", 44: "driver enable",
}  # fmt: skip
QUERY = bytes((READ_FLOAT, 4, MODE, READ_INT8 | 1, FAULT))
"""Mode, position, velocity and torque as floats, and the fault code."""
MOST_REGISTERS = 64
"""Values in a group of an answer; a CAN FD frame has 64 bytes, so a larger count is damage."""


class MoteusCodec:
    """One moteus; positions in turns of its output shaft."""

    unit: AngleUnit = "turn"
    asks = True
    reports_time_out = True
    reach = math.inf

    def __init__(
        self, servo_id: int, torque_max: float, velocity_max: float, watchdog_s: float
    ) -> None:
        self._id = servo_id
        self._torque_max = torque_max
        self._velocity_max = velocity_max
        self._watchdog_s = watchdog_s

    def _frame(self, body: bytes) -> Frame:
        size = next(size for size in FD_SIZES if size >= len(body))
        padded = body.ljust(size, bytes((NOP,)))
        return Frame(ANSWER_WANTED | self._id, padded, extended=True, fd=True)

    def _command(
        self, position: float, velocity: float, torque: float, kp: float, kd: float
    ) -> Frames:
        """Return position mode with registers 0x020 to 0x028, and the query."""
        values = struct.pack(
            "<9f", position, velocity, torque, kp, kd,
            self._torque_max, math.nan, self._watchdog_s, self._velocity_max,
        )  # fmt: skip
        mode = bytes((WRITE_INT8 | 1, MODE, POSITION_MODE))
        return (self._frame(mode + bytes((WRITE_FLOAT, 9, COMMAND)) + values + QUERY),)

    def opening(self) -> Frames:
        """Return stopped, which clears faults."""
        return self.disable()

    def enable(self, position: float) -> Frames:
        """Return position mode where the shaft is."""
        return self.follow(position, 0.0)

    def disable(self) -> Frames:
        """Return mode stopped, and the query."""
        return (self._frame(bytes((WRITE_INT8 | 1, MODE, STOPPED)) + QUERY),)

    def follow(self, position: float, velocity: float) -> Frames:
        """Return position mode at a position and velocity."""
        return self._command(position, velocity, 0.0, 1.0, 1.0)

    def brake(self) -> Frames:
        """Return position mode that stands: at its own position, not at one that was reported.

        It cannot damp alone: its scale of kd counts up to that of kp (registers.md, 0x024).
        """
        return self._command(math.nan, 0.0, 0.0, 1.0, 1.0)

    def push(self, torque: float) -> Frames:
        """Return position mode with a torque alone."""
        return self._command(math.nan, 0.0, torque, 0.0, 0.0)

    def question(self) -> Frame:
        """Return the query alone, which is answered as a command is."""
        return self._frame(QUERY)

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take an answer of our servo."""
        if frame.can_id & 0x7FFF in {self._id, ANSWER_WANTED | self._id}:
            return Taken.FOREIGN
        if frame.can_id != self._id << 8:
            return Taken.OTHER
        found = registers(frame.data) if len(frame.data) in FD_SIZES else None
        if found is None or not {MODE, POSITION, VELOCITY, TORQUE, FAULT} <= set(found):
            return report.refuse("wrong_length")
        values = [found[register] for register in (POSITION, VELOCITY, TORQUE, MODE, FAULT)]
        if not all(math.isfinite(value) for value in values):
            return report.refuse("not_a_number")
        self._note_state(int(found[MODE]), int(found[FAULT]), report)
        report.position, report.velocity, report.torque = values[:3]
        return Taken.MEASURED

    @staticmethod
    def _note_state(mode: int, fault: int, report: Report) -> None:
        report.complaint = ""
        if mode == FAULTED:
            words = FAULT_WORDS.get(fault, "see registers.md")
            report.complaint = f"moteus fault {fault}: {words}"
        elif mode == TIMED_OUT:
            report.complaint = "moteus timed out: no command within its watchdog"
        failed = mode in {FAULTED, TIMED_OUT}
        report.state = DriveState.FAULT if failed else STATES.get(mode, DriveState.BUSY)


def registers(data: bytes) -> dict[int, float] | None:
    """Return the registers of an answer, None for a frame that is not an answer."""
    found: dict[int, float] = {}
    at = 0
    try:
        while at < len(data):
            head, at = data[at], at + 1
            if head == NOP:
                continue
            if not REPLY <= head < REPLY + 0x10:
                return None
            code, size = TYPES[head >> 2 & 3]
            count = head & 3
            if count == 0:
                count, at = _varuint(data, at)
            start, at = _varuint(data, at)
            if count > MOST_REGISTERS:
                return None
            values = struct.unpack_from(f"<{count}{code}", data, at)
            at += count * size
            found |= {start + index: value for index, value in enumerate(values)}
    except (IndexError, struct.error):
        return None
    return found


def _varuint(data: bytes, at: int) -> tuple[int, int]:
    """Return a number of 7 bits a byte and where it ends. Raises IndexError where it does not."""
    value = shift = 0
    while True:
        byte, at = data[at], at + 1
        value |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return value, at
