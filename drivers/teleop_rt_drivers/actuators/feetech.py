"""Feetech's protocol of bus servos and the memory table of the STS and SMS series.

Source: Feetech, FT-SCS communication protocol and memory table of SMS/STS. Two bytes FFh, id,
length, instruction or error, parameters, and the inverted sum of all but the header. Sync writes
are never answered, so a cycle has one question and one answer.
"""

from __future__ import annotations

import struct

from teleop_rt_drivers.actuators.bus_servo import BusServoCodec
from teleop_rt_drivers.actuators.codec import AngleUnit, DriveState, Frame, Frames, Report, Taken

HEADER, BROADCAST = b"\xff\xff", 0xFE
# Instructions, then addresses of the memory table of the STS series.
SYNC_READ, SYNC_WRITE = 0x82, 0x83
RETURN_DELAY, ANGLE_LIMITS, PHASE, OPERATING_MODE = 7, 9, 18, 33
TORQUE_ENABLE, ACCELERATION, TORQUE_LIMIT = 40, 41, 48
ASKED = 31
"""Bytes from TORQUE_ENABLE on: state, goal, position, speed, load, error and current."""
_asked = struct.Struct("<B15xHHHBBxB3xH")
_goal = struct.Struct("<BHHH")

COUNTS_PER_TURN = 4096  # 12 bits, by the memory table of the STS series
MOST_COUNTS = 2**15 - 1
"""Of a goal, whose 16th bit is its sign."""
AMPERES_PER_COUNT = 6.5e-3
"""Of the current in its answer, by the maker's table."""
ERRORS = {
    0x01: "voltage", 0x02: "encoder", 0x04: "over-temperature", 0x08: "over-current",
    0x20: "overload",
}  # fmt: skip


class FeetechCodec(BusServoCodec):
    """One servo of the STS or SMS series in position mode; positions in turns."""

    unit: AngleUnit = "turn"
    asks = True
    reports_time_out = True
    reach = MOST_COUNTS / COUNTS_PER_TURN
    header = HEADER
    answer_bytes = 6 + ASKED
    longest = 64

    def __init__(
        self, servo_id: int, torque_constant: float, velocity_max: float, torque_share: float
    ) -> None:
        self._id = servo_id
        self._torque_per_count = torque_constant * AMPERES_PER_COUNT
        self._fastest = max(1, min(MOST_COUNTS, round(COUNTS_PER_TURN * velocity_max)))
        self._torque_limit = round(1e3 * torque_share)
        self._ask = self.read(TORQUE_ENABLE, ASKED)
        self._on, self._off = (self._write(TORQUE_ENABLE, bytes((value,))) for value in (1, 0))
        self._last_goal = self._off  # until there is one

    def read(self, register: int, size: int) -> Frame:
        """Return the question for registers."""
        return Frame(0, packet(BROADCAST, SYNC_READ, bytes((register, size, self._id))))

    def _write(self, register: int, data: bytes) -> Frame:
        parameters = bytes((register, len(data), self._id)) + data
        return Frame(0, packet(BROADCAST, SYNC_WRITE, parameters))

    def opening(self) -> Frames:
        """Return no torque, and the limit of torque."""
        return self._off, self._write(TORQUE_LIMIT, struct.pack("<H", self._torque_limit))

    def _goal(self, position: float) -> Frame:
        counts = max(-MOST_COUNTS, min(MOST_COUNTS, round(COUNTS_PER_TURN * position)))
        goal = abs(counts) | (0x8000 if counts < 0 else 0)
        self._last_goal = self._write(ACCELERATION, _goal.pack(0, goal, 0, self._fastest))
        return self._last_goal

    def brake(self) -> Frames:
        """Return the last goal: a reported position may be damaged, which 8 bits do not show."""
        return self._last_goal, self._ask

    def size(self, begun: bytearray) -> int:
        """Return the size of a packet by its length field, 0 while that is not there."""
        if len(begun) < 4:
            return 0
        return self.longest + 1 if begun[2] == 0xFF else 4 + begun[3]

    def sound(self, packet: bytes) -> bool:
        """Return whether the checksum is right, of a packet long enough for an instruction."""
        return len(packet) >= 6 and checksum(packet[2:-1]) == packet[-1]

    def registers(self, frame: Frame) -> bytes | None:
        """Return error and registers of a packet of our servo; None for another's."""
        return frame.data[4:-1] if frame.data[2] == self._id else None

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take an answer of our servo: error, and the registers asked for."""
        if frame.data[2] == BROADCAST:
            return Taken.FOREIGN
        content = self.registers(frame)
        if content is None:
            return Taken.OTHER
        if len(content) != 1 + ASKED:
            return report.refuse("wrong_length")
        torque, position, speed, load, _, _, error, current = _asked.unpack(content[1:])
        if torque > 1 or position == 0x8000:
            return report.refuse("bad_status")
        error |= content[0]
        report.state, report.complaint = DriveState.FOLLOWING if torque else DriveState.OFF, ""
        if error:
            words = ", ".join(text for bit, text in ERRORS.items() if error & bit)
            report.state, report.complaint = (
                DriveState.FAULT,
                f"Feetech error 0x{error:02X}: {words}",
            )
        report.position = signed(position, 15) / COUNTS_PER_TURN
        report.velocity = signed(speed, 15) / COUNTS_PER_TURN
        backwards = load & 0x400 or current & 0x8000
        amount = (current & 0x7FFF) * self._torque_per_count
        report.torque = -amount if backwards else amount
        return Taken.MEASURED


def packet(whom: int, instruction: int, parameters: bytes) -> bytes:
    """Return an instruction packet."""
    body = bytes((whom, len(parameters) + 2, instruction)) + parameters
    return HEADER + body + bytes((checksum(body),))


def checksum(body: bytes) -> int:
    """Return the inverted sum of all bytes but the header's."""
    return ~sum(body) & 0xFF


def signed(number: int, bit: int) -> int:
    """Return a number whose sign stands in a bit of its own."""
    amount = number & (1 << bit) - 1
    return -amount if number >> bit & 1 else amount
