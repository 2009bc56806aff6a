"""The motors with an impedance loop of their own ("MIT mode"): Damiao, CyberGear, RobStride.

A command holds position, velocity, stiffness kp, damping kd and torque, each as a whole number over
a range that drive and daemon must agree on; the motor pushes kp (p - x) + kd (v - x') + t. Each
command is answered, and so is a question. Sources: Damiao, cmjang/DM_Control_Python, DM_CAN.py (the
question is `refresh_motor_status` of its later versions), and the error codes of its manual;
CyberGear, the maker's manual (belovictor/cybergear-docs), chapter 4; RobStride,
kscalelabs/robstride, src/protocol.rs and src/actuator_types.rs.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from teleop_rt_drivers.actuators.codec import AngleUnit, DriveState, Frame, Frames, Report, Taken


@dataclass(frozen=True, slots=True)
class Ranges:
    """Values of the largest codes: rad, rad/s, Nm, Nm/rad, Nm s/rad."""

    position: float
    velocity: float
    torque: float
    stiffness: float = 500.0
    damping: float = 5.0


def whole(value: float, low: float, high: float, bits: int) -> int:
    """Return a value as the nearest whole number of `bits` over a range, kept within it."""
    share = (min(max(value, low), high) - low) / (high - low)
    return round(share * ((1 << bits) - 1))


def real(number: int, low: float, high: float, bits: int) -> float:
    """Return the value of a whole number of `bits` over a range."""
    return low + number * (high - low) / ((1 << bits) - 1)


@dataclass(frozen=True, slots=True)
class Gains:
    """Stiffness [Nm/rad] and damping [Nm s/rad] of the motor's own loop."""

    kp: float
    kd: float


@dataclass(frozen=True, slots=True)
class MotorLimits:
    """Limits written into a motor that accepts them: torque [Nm], command timeout [ms]."""

    torque: float
    timeout_ms: int | None


class MitCodec:
    """Common base of the makers' codecs; a subclass packs a command and reads an answer."""

    unit: AngleUnit = "rad"
    asks = True
    reports_time_out = True
    torque_bits = 16

    def __init__(self, ranges: Ranges, gains: Gains) -> None:
        self.ranges = ranges
        self._gains = gains
        self._unpaid = 0.0

    @property
    def reach(self) -> float:
        """Largest position of either sign that a command can hold [rad]."""
        return self.ranges.position

    def impedance(
        self, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> Frame:
        """Return the command to push kp (p - x) + kd (v - x') + t."""
        raise NotImplementedError

    def follow(self, position: float, velocity: float) -> Frames:
        """Return the command to go to a position at a velocity, by the loop's gains."""
        return (self.impedance(position, velocity, self._gains.kp, self._gains.kd, 0.0),)

    def brake(self) -> Frames:
        """Return the command to come to rest by damping alone."""
        return (self.impedance(0.0, 0.0, 0.0, self._gains.kd, 0.0),)

    def question(self) -> Frame:
        """Return the frame that asks for the position, and commands nothing."""
        raise NotImplementedError

    def push(self, torque: float) -> Frames:
        """Return the command to push with a torque, and nothing else; its mean is exact.

        None of its codes is 0; the nearest one pushes for ever, by 2.4 mNm over 12 bits of 10 Nm.
        The rounding error of a command is therefore added to the next one.
        """
        top, bits = self.ranges.torque, self.torque_bits
        wanted = min(max(torque, -top), top) + self._unpaid
        sent = real(whole(wanted, -top, top, bits), -top, top, bits)
        self._unpaid = wanted - sent
        return (self.impedance(0.0, 0.0, 0.0, 0.0, sent),)


DAMIAO_RANGES = {
    "DM4310": Ranges(12.5, 30.0, 10.0),
    "DM4310_48V": Ranges(12.5, 50.0, 10.0),
    "DM4340": Ranges(12.5, 10.0, 28.0),
    "DM6006": Ranges(12.5, 45.0, 20.0),
    "DM8006": Ranges(12.5, 45.0, 40.0),
    "DM8009": Ranges(12.5, 45.0, 54.0),
}
"""Ranges as delivered; the maker's tool can change them."""
DAMIAO_ERRORS = {
    0x8: "over-voltage", 0x9: "under-voltage", 0xA: "over-current",
    0xB: "over-temperature of the bridge", 0xC: "over-temperature of the coils",
    0xD: "communication lost: no command within its time-out", 0xE: "overload",
}  # fmt: skip
# Last byte of a command without values; id and command of a question (Damiao's protocol).
ENABLE, DISABLE, CLEAR = 0xFC, 0xFD, 0xFB
TO_ALL, REFRESH = 0x7FF, 0xCC
DAMIAO_STATES = {0: DriveState.OFF, 1: DriveState.FOLLOWING}


class DamiaoCodec(MitCodec):
    """A Damiao motor in MIT mode: commands under its own id, answers under the master's."""

    torque_bits = 12

    def __init__(self, motor_id: int, master_id: int, ranges: Ranges, gains: Gains) -> None:
        super().__init__(ranges, gains)
        self._motor_id = motor_id
        self._master_id = master_id

    def _order(self, order: int) -> Frame:
        return Frame(self._motor_id, b"\xff" * 7 + bytes((order,)))

    def opening(self) -> Frames:
        """Return disable and clear errors."""
        return self._order(DISABLE), self._order(CLEAR)

    def enable(self, position: float) -> Frames:  # noqa: ARG002 - without gains nothing moves
        """Return enable, and a command that asks for nothing."""
        return self._order(ENABLE), self.impedance(0.0, 0.0, 0.0, 0.0, 0.0)

    def disable(self) -> Frames:
        """Return disable."""
        return (self._order(DISABLE),)

    def impedance(
        self, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> Frame:
        """Return p 16 bits, v 12, kp 12, kd 12, t 12, the highest bit first."""
        top = self.ranges
        packed = whole(position, -top.position, top.position, 16) << 48
        packed |= whole(velocity, -top.velocity, top.velocity, 12) << 36
        packed |= whole(kp, 0.0, top.stiffness, 12) << 24
        packed |= whole(kd, 0.0, top.damping, 12) << 12
        packed |= whole(torque, -top.torque, top.torque, self.torque_bits)
        return Frame(self._motor_id, packed.to_bytes(8, "big"))

    def question(self) -> Frame:
        """Return the request for a status, which is answered as a command is."""
        return Frame(TO_ALL, struct.pack("<HB5x", self._motor_id, REFRESH))

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take id and error 4 bits each, p 16, v 12, t 12, two temperatures."""
        if frame.extended or frame.can_id not in {self._master_id, self._motor_id}:
            return Taken.OTHER
        if frame.can_id == self._motor_id:
            return Taken.FOREIGN
        if len(frame.data) != 8:
            return report.refuse("wrong_length")
        if frame.data[0] & 0x0F != self._motor_id & 0x0F:
            return Taken.OTHER
        packed, top = int.from_bytes(frame.data[:6], "big"), self.ranges
        error = packed >> 44 & 0x0F
        report.state = DAMIAO_STATES.get(error, DriveState.FAULT)
        report.complaint = ""
        if report.state is DriveState.FAULT:
            words = DAMIAO_ERRORS.get(error, "see the manual")
            report.complaint = f"Damiao error 0x{error:X}: {words}"
        report.position = real(packed >> 24 & 0xFFFF, -top.position, top.position, 16)
        report.velocity = real(packed >> 12 & 0xFFF, -top.velocity, top.velocity, 12)
        report.torque = real(packed & 0xFFF, -top.torque, top.torque, 12)
        return Taken.MEASURED


FOUR_PI = 4.0 * math.pi  # rad: two turns to either side, as far as these motors count
TYPED_RANGES = {
    "cybergear": Ranges(FOUR_PI, 30.0, 12.0),
    "robstride00": Ranges(FOUR_PI, 33.0, 14.0),
    "robstride01": Ranges(FOUR_PI, 44.0, 17.0),
    "robstride02": Ranges(FOUR_PI, 44.0, 17.0),
    "robstride03": Ranges(FOUR_PI, 20.0, 60.0, 5000.0, 100.0),
    "robstride04": Ranges(FOUR_PI, 15.0, 120.0, 5000.0, 100.0),
}
TYPED_FAULTS = {
    0x01: "under-voltage", 0x02: "over-current", 0x04: "over-temperature",
    0x08: "magnetic encoder failed", 0x10: "Hall encoder failed", 0x20: "not calibrated",
}  # fmt: skip
"""Bits 16 to 21 of an answer's id."""
FAULT_VALUES = {
    0x01: "over-temperature of the motor", 0x02: "bridge chip failed", 0x04: "under-voltage",
    0x08: "over-voltage", 0x10010: "over-current of phase A or B", 0x20: "over-current of phase C",
    0x80: "encoder not calibrated", 0xFF00: "overload or start-up check failed",
}  # fmt: skip
"""Bits of the fault value that a message of its own contains (CyberGear's manual, 4.1.10)."""
# Types of messages in the id, and indices of parameters (CyberGear's manual, 4.1).
CONTROL, ANSWER, ENABLE_TYPE, STOP_TYPE, READ, WRITE, FAULTS_TYPE = 1, 2, 3, 4, 17, 18, 21
RUN_MODE, LIMIT_TORQUE, MECHANICAL_POSITION, CAN_TIMEOUT = 0x7005, 0x700B, 0x7019, 0x7028
TIMEOUT_PER_MS = 20
"""Counts of CAN_TIMEOUT in a millisecond: 20000 is a second."""
TYPED_STATES = {0: DriveState.OFF, 2: DriveState.FOLLOWING}
_numbers = struct.Struct(">HHHH")
_parameter = struct.Struct("<HHf")


class TypedCodec(MitCodec):
    """CyberGear and RobStride: the kind of a frame stands in its id of 29 bits.

    id = type << 24 | data << 8 | target; the torque of a command is in its id, too.
    """

    def __init__(
        self, motor_id: int, host_id: int, ranges: Ranges, gains: Gains, limits: MotorLimits
    ) -> None:
        super().__init__(ranges, gains)
        self._motor_id = motor_id
        self._host_id = host_id
        self._limits = limits
        self._fault_value = 0

    def _frame(self, kind: int, data: bytes = bytes(8), word: int | None = None) -> Frame:
        middle = self._host_id if word is None else word
        return Frame(kind << 24 | middle << 8 | self._motor_id, data, extended=True)

    def opening(self) -> Frames:
        """Return stop with faults cleared, operation control mode, and the limits."""
        self._fault_value = 0
        frames = [
            self._frame(STOP_TYPE, b"\x01" + bytes(7)),
            self._frame(WRITE, struct.pack("<HHB3x", RUN_MODE, 0, 0)),
            self._frame(WRITE, struct.pack("<HHf", LIMIT_TORQUE, 0, self._limits.torque)),
        ]
        if (timeout_ms := self._limits.timeout_ms) is not None:
            counts = round(timeout_ms * TIMEOUT_PER_MS)
            frames.append(self._frame(WRITE, struct.pack("<HHI", CAN_TIMEOUT, 0, counts)))
        return tuple(frames)

    def enable(self, position: float) -> Frames:  # noqa: ARG002 - without gains nothing moves
        """Return enable, and a command that asks for nothing."""
        return self._frame(ENABLE_TYPE), self.impedance(0.0, 0.0, 0.0, 0.0, 0.0)

    def disable(self) -> Frames:
        """Return stop."""
        return (self._frame(STOP_TYPE),)

    def impedance(
        self, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> Frame:
        """Return p, v, kp and kd of 16 bits each, the highest byte first; t is in the id."""
        top = self.ranges
        data = _numbers.pack(
            whole(position, -top.position, top.position, 16),
            whole(velocity, -top.velocity, top.velocity, 16),
            whole(kp, 0.0, top.stiffness, 16),
            whole(kd, 0.0, top.damping, 16),
        )
        return self._frame(CONTROL, data, whole(torque, -top.torque, top.torque, self.torque_bits))

    def question(self) -> Frame:
        """Return the request to read the position; a CyberGear needs firmware 1.2.1.5."""
        return self._frame(READ, _parameter.pack(MECHANICAL_POSITION, 0, 0.0))

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take an answer: who sends it, and to whom, is in the id."""
        if not frame.extended:
            return Taken.OTHER
        kind, motor, host = frame.can_id >> 24, frame.can_id >> 8 & 0xFF, frame.can_id & 0xFF
        if kind == CONTROL and host == self._motor_id:
            return Taken.FOREIGN
        if kind == FAULTS_TYPE and {motor, host} == {self._motor_id, self._host_id}:
            return self._take_faults(frame.data, report)
        if kind not in {ANSWER, READ} or motor != self._motor_id or host != self._host_id:
            return Taken.OTHER
        take = self._take_position if kind == READ else self._take_answer
        return take(frame, report)

    def _take_answer(self, frame: Frame, report: Report) -> Taken:
        """Take faults and mode from the id; position, velocity, torque and temperature."""
        if len(frame.data) != _numbers.size:
            return report.refuse("wrong_length")
        faults, mode = frame.can_id >> 16 & 0x3F, frame.can_id >> 22 & 0x03
        report.state, report.complaint = TYPED_STATES.get(mode, DriveState.BUSY), ""
        if faults or self._fault_value:
            report.state, report.complaint = DriveState.FAULT, self._complaint(faults)
        top = self.ranges
        position, velocity, torque, _ = _numbers.unpack(frame.data)
        report.position = real(position, -top.position, top.position, 16)
        report.velocity = real(velocity, -top.velocity, top.velocity, 16)
        report.torque = real(torque, -top.torque, top.torque, 16)
        return Taken.MEASURED

    def _take_faults(self, data: bytes, report: Report) -> Taken:
        """Take the fault value, which contains more than an answer does, until faults are cleared.

        The manual gives the id of this message as that of a request: both orders are taken.
        """
        if len(data) != _numbers.size:
            return report.refuse("wrong_length")
        self._fault_value = int.from_bytes(data[:4], "little")
        if self._fault_value:
            report.state, report.complaint = DriveState.FAULT, self._complaint(0)
        return Taken.STATE

    @staticmethod
    def _take_position(frame: Frame, report: Report) -> Taken:
        """Take a parameter that was read; bits 16 to 23 of the id say whether it could be."""
        if len(frame.data) != _parameter.size:
            return report.refuse("wrong_length")
        index, _, position = _parameter.unpack(frame.data)
        if index != MECHANICAL_POSITION or frame.can_id >> 16 & 0xFF:
            return Taken.NOTED
        if not math.isfinite(position):
            return report.refuse("not_a_number")
        report.position = position
        return Taken.PLACED

    def _complaint(self, faults: int) -> str:
        words = [text for bit, text in TYPED_FAULTS.items() if faults & bit]
        words += [text for bits, text in FAULT_VALUES.items() if self._fault_value & bits]
        code = f"0x{self._fault_value:X}" if self._fault_value else f"0x{faults:02X}"
        return f"motor fault {code}: {', '.join(words) or 'see the manual'}"
