"""Dynamixel's protocol 2 and the control table of its X series.

Source: ROBOTIS-GIT/emanual, docs/en/dxl/protocol2.md and the control tables of docs/en/dxl/x. The
registers of a cycle are spread over the table: indirect addresses put them side by side, so that
one sync read brings all. Sync writes are not answered, so a cycle has one question and one answer.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from teleop_rt_drivers.actuators.bus_servo import BusServoCodec
from teleop_rt_drivers.actuators.codec import AngleUnit, DriveState, Frame, Frames, Report, Taken

HEADER, BROADCAST = b"\xff\xff\xfd\x00", 0xFE
SYNC_READ, SYNC_WRITE, STATUS = 0x82, 0x83, 0x55  # instructions of Protocol 2.0
STUFFED = b"\xff\xff\xfd"
"""Bytes of a header inside a packet, behind which one more FDh is put."""

# Addresses of the maker's control table (X series), and two of its values.
MODEL, FIRMWARE, RETURN_DELAY, OPERATING_MODE, CURRENT_LIMIT, VELOCITY_LIMIT = 0, 6, 9, 11, 38, 44
TORQUE_ENABLE, STATUS_RETURN_LEVEL, HARDWARE_ERROR, WATCHDOG, GOAL_CURRENT = 64, 68, 70, 98, 102
PROFILE, GOAL_POSITION, CURRENT, VELOCITY, POSITION = 108, 116, 126, 128, 132
INDIRECT_ADDRESS, INDIRECT_DATA = 168, 224
CURRENT_BASED_POSITION = 5
ANSWERS_READS = 1
ASKED = ((OPERATING_MODE, 1), (TORQUE_ENABLE, 1), (HARDWARE_ERROR, 1), (WATCHDOG, 1),
         (CURRENT, 2), (VELOCITY, 4), (POSITION, 4))  # fmt: skip
"""Registers that each answer holds, with their sizes."""
_asked = struct.Struct("<BBBbhii")

COUNTS_PER_TURN = 4096  # 12 bits, by the control table of the X series
MOST_COUNTS = 1_048_575
"""Of a goal in either direction: 256 turns."""
RPM_PER_COUNT = 0.229  # of velocities, by the control table of the X series
WATCHDOG_STEP_MS = 20
"""Units of VELOCITY and of WATCHDOG, by the maker's control table."""
HARDWARE_ERRORS = {
    0x01: "input voltage", 0x04: "overheating: over-temperature", 0x08: "motor encoder",
    0x10: "electrical shock", 0x20: "overload",
}  # fmt: skip
ALERT = 0x80
"""Bit of a status packet's error: see the hardware error."""


@dataclass(frozen=True, slots=True)
class ServoLimits:
    """Limits written to the drive: speed, current, and time without a packet."""

    velocity_max: float
    """Turns per second."""
    current_max_A: float
    amperes_per_count: float
    watchdog_ms: int


class DynamixelCodec(BusServoCodec):
    """One Dynamixel of the X series in current-based position mode; positions in turns."""

    unit: AngleUnit = "turn"
    asks = True
    reports_time_out = True
    reach = MOST_COUNTS / COUNTS_PER_TURN
    header = HEADER
    answer_bytes = 11 + _asked.size + _asked.size // 3
    longest = 64

    def __init__(self, servo_id: int, torque_constant: float, limits: ServoLimits) -> None:
        self._id = servo_id
        self._torque_per_count = torque_constant * limits.amperes_per_count
        self.fastest = max(1, round(60.0 * limits.velocity_max / RPM_PER_COUNT))
        self.current = round(limits.current_max_A / limits.amperes_per_count)
        self._watchdog = limits.watchdog_ms // WATCHDOG_STEP_MS
        self._ask = self.read(INDIRECT_DATA, _asked.size)
        self._on, self._off = (self._write(TORQUE_ENABLE, bytes((value,))) for value in (1, 0))
        self._last_goal = self._off  # until there is one

    def read(self, register: int, size: int) -> Frame:
        """Return the question for registers."""
        parameters = struct.pack("<HHB", register, size, self._id)
        return Frame(0, packet(BROADCAST, SYNC_READ, parameters))

    def _write(self, register: int, data: bytes) -> Frame:
        parameters = struct.pack("<HHB", register, len(data), self._id) + data
        return Frame(0, packet(BROADCAST, SYNC_WRITE, parameters))

    def opening(self) -> Frames:
        """Return no torque, mode, limits and watchdog, and the indirect addresses."""
        addresses = [first + place for first, size in ASKED for place in range(size)]
        return (
            self._off,
            self._write(WATCHDOG, b"\0"),  # clears its error
            self._write(STATUS_RETURN_LEVEL, bytes((ANSWERS_READS,))),
            self._write(OPERATING_MODE, bytes((CURRENT_BASED_POSITION,))),
            self._write(GOAL_CURRENT, struct.pack("<h", self.current)),
            self._write(PROFILE, struct.pack("<II", 0, self.fastest)),
            self._write(INDIRECT_ADDRESS, struct.pack(f"<{len(addresses)}H", *addresses)),
            self._write(WATCHDOG, bytes((self._watchdog,))),
        )

    def _goal(self, position: float) -> Frame:
        counts = max(-MOST_COUNTS, min(MOST_COUNTS, round(COUNTS_PER_TURN * position)))
        self._last_goal = self._write(GOAL_POSITION, struct.pack("<i", counts))
        return self._last_goal

    def brake(self) -> Frames:
        """Return the last goal: a reported position may be damaged."""
        return self._last_goal, self._ask

    def size(self, begun: bytearray) -> int:
        """Return the size of a packet by its length field, 0 while that is not there."""
        return 7 + int.from_bytes(begun[5:7], "little") if len(begun) >= 7 else 0

    def sound(self, packet: bytes) -> bool:
        """Return whether the CRC is right, of a packet long enough for an instruction."""
        return len(packet) >= 10 and crc16(packet[:-2]) == int.from_bytes(packet[-2:], "little")

    def registers(self, frame: Frame) -> bytes | None:
        """Return the contents of our drive's status packet; None for another packet."""
        found = frame.data
        if found[4] != self._id or found[7] != STATUS:
            return None
        return found[7:-2].replace(STUFFED + b"\xfd", STUFFED)[1:]

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take an answer of our drive: error, and the registers asked for."""
        whom, instruction = frame.data[4], frame.data[7]
        if instruction != STATUS and whom in {BROADCAST, self._id}:
            return Taken.FOREIGN
        content = self.registers(frame)
        if content is None:
            return Taken.OTHER
        if len(content) != 1 + _asked.size:
            return report.refuse("wrong_length")
        if content[0] & ~ALERT:
            return report.refuse("bad_status")
        mode, torque, error, watchdog, current, velocity, position = _asked.unpack(content[1:])
        self._note_state(mode, torque, error, watchdog, report)
        if content[0] & ALERT and not error:
            report.state, report.complaint = DriveState.FAULT, "Dynamixel alert without a cause"
        report.position = position / COUNTS_PER_TURN
        report.velocity = velocity * RPM_PER_COUNT / 60.0
        report.torque = current * self._torque_per_count
        return Taken.MEASURED

    def _note_state(
        self, mode: int, torque: int, error: int, watchdog: int, report: Report
    ) -> None:
        report.state, report.complaint = DriveState.FOLLOWING if torque else DriveState.OFF, ""
        if error:
            words = ", ".join(text for bit, text in HARDWARE_ERRORS.items() if error & bit)
            report.complaint = f"Dynamixel hardware error 0x{error:02X}: {words}; reboot it"
        elif watchdog < 0:
            report.complaint = "Dynamixel bus watchdog: no packet within watchdog_ms"
        elif watchdog != self._watchdog or mode != CURRENT_BASED_POSITION:
            report.complaint = "Dynamixel is not set up: it was reset, or refused mode or watchdog"
        if report.complaint:
            report.state = DriveState.FAULT


def packet(whom: int, instruction: int, parameters: bytes) -> bytes:
    """Return an instruction packet: stuffed first, then its length, then its CRC."""
    body = (bytes((instruction,)) + parameters).replace(STUFFED, STUFFED + b"\xfd")
    head = HEADER + bytes((whom,)) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


def _remainders() -> tuple[int, ...]:
    """Return the remainders of all bytes, most significant bit first."""
    table = []
    for byte in range(256):
        word = byte << 8
        for _ in range(8):
            word = (word << 1 ^ (0x8005 if word & 0x8000 else 0)) & 0xFFFF
        table.append(word)
    return tuple(table)


_REMAINDERS = _remainders()


def crc16(data: bytes) -> int:
    """Return the CRC of polynomial 8005h from 0, not reflected."""
    value = 0
    for byte in data:
        value = (value << 8 & 0xFF00) ^ _REMAINDERS[value >> 8 ^ byte]
    return value
