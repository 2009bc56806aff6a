"""VESC on its own CAN mode: a position of one turn, a current, and status messages by themselves.

Source: vedderb/bldc, documentation/comm_can.md. An id of 29 bits is command << 8 | id; numbers are
big endian and signed. A VESC says neither whether it has power nor which fault it has: it follows
the last command, until none has come for its time-out. So its state follows from its commands;
a drive that does not obey is found as a following error.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

from teleop_rt_drivers.actuators.codec import AngleUnit, DriveState, Frame, Frames, Report, Taken

# CAN_PACKET_ID of VESC's firmware, in the second byte of the id.
SET_DUTY, SET_CURRENT, SET_POSITION, STATUS, STATUS_4 = 0, 1, 4, 9, 16
ORDERS = frozenset({SET_DUTY, SET_CURRENT, 2, 3, SET_POSITION, 10, 11, 12, 13})
"""Commands that move the motor: of one master alone."""
PER_AMPERE, PER_DEGREE = 1e3, 1e6  # counts of a command
_status, _status_4 = struct.Struct(">ihh"), struct.Struct(">hhhh")
_argument = struct.Struct(">i")
HALF_TURN, TURN = 180.0, 360.0  # degrees
REACH = 0.49
"""A position of a turn and more is another one: the last hundredth keeps both ends apart."""


@dataclass(frozen=True, slots=True)
class VescMotor:
    """Scale of a VESC's values."""

    pole_pairs: int
    turns_per_unit: float
    """Turns of the motor in one of the position: p_pid_ang_div."""
    torque_constant: float
    """Nm/A at the motor."""
    current_max_A: float
    temperature_max_C: float


class VescCodec:
    """One VESC; positions in turns from the middle of its range, 180 degrees."""

    unit: AngleUnit = "turn"
    asks = False
    reports_time_out = False
    reach = REACH

    def __init__(self, controller_id: int, motor: VescMotor) -> None:
        self._id = controller_id
        self._motor = motor
        self._torque_per_A = motor.torque_constant * motor.turns_per_unit
        self._follows = False
        self._goal: Frames = ()

    def _frame(self, command: int, value: float) -> Frame:
        return Frame(command << 8 | self._id, _argument.pack(round(value)), extended=True)

    def opening(self) -> Frames:
        """Return no current."""
        return self.disable()

    def enable(self, position: float) -> Frames:
        """Return a position where the shaft is: there is no other way to give power."""
        self._follows = True
        return self.follow(position, 0.0)

    def disable(self) -> Frames:
        """Return no current, at which the motor is let go."""
        self._follows = False
        return (self._frame(SET_CURRENT, 0.0),)

    def follow(self, position: float, velocity: float) -> Frames:  # noqa: ARG002 - it takes none
        """Return a position in degrees."""
        within = max(-REACH, min(REACH, position))
        self._goal = (self._frame(SET_POSITION, PER_DEGREE * (HALF_TURN + TURN * within)),)
        return self._goal

    def brake(self) -> Frames:
        """Return the last position: a reported one may be damaged."""
        return self._goal

    def push(self, torque: float) -> Frames:
        """Return a current, no larger than its limit."""
        most = self._motor.current_max_A
        current = max(-most, min(most, torque / self._torque_per_A))
        return (self._frame(SET_CURRENT, PER_AMPERE * current),)

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take speed and current, or temperatures and position, of our controller."""
        command, whom = frame.can_id >> 8, frame.can_id & 0xFF
        if not frame.extended or whom != self._id:
            return Taken.OTHER
        if command in ORDERS:
            return Taken.FOREIGN
        if command not in {STATUS, STATUS_4}:
            return Taken.NOTED
        if len(frame.data) != _status.size:
            return report.refuse("wrong_length")
        return self._take_status(command, frame.data, report)

    def _take_status(self, command: int, data: bytes, report: Report) -> Taken:
        if command == STATUS:
            erpm, current, _ = _status.unpack(data)
            per_s = erpm / (60.0 * self._motor.pole_pairs)
            report.velocity = per_s / self._motor.turns_per_unit
            report.torque = 0.1 * current * self._torque_per_A
            return Taken.STATE
        bridge, motor, _, position = _status_4.unpack(data)
        if not 0 <= position <= 50 * TURN:
            return report.refuse("out_of_range")
        self._note_state(0.1 * max(bridge, motor), report)
        report.position = (position / 50.0 - HALF_TURN) / TURN
        return Taken.MEASURED

    def _note_state(self, hottest_C: float, report: Report) -> None:
        report.state, report.complaint = (
            DriveState.FOLLOWING if self._follows else DriveState.OFF,
            "",
        )
        if hottest_C > self._motor.temperature_max_C:
            report.state = DriveState.FAULT
            report.complaint = f"VESC over-temperature: {hottest_C:.0f} C"
