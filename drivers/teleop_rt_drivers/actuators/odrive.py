"""ODrive's CANSimple, firmware 0.5.4 and later of the 0.5 series.

Source: odriverobotics/ODrive, docs/can-protocol.rst, docs/_static/can-protocol.csv, and for the
sizes of messages tools/odrive-cansimple.dbc. An id of 11 bits is node << 5 | command; all numbers
are little endian. Heartbeat and encoder estimates come of the drive's own accord, every
axis.config.can.heartbeat_rate_ms and encoder_rate_ms.

The watchdog runs in every state (Firmware/MotorControl/main.cpp): an axis without power that hears
nothing has its error set. That is no fault, and cleared before power is given.
"""

from __future__ import annotations

import math
import struct

from teleop_rt_drivers.actuators.codec import AngleUnit, DriveState, Frame, Frames, Report, Taken

# Commands in the lowest five bits of the id (ODrive's CAN protocol).
HEARTBEAT, ESTOP, SET_STATE, ESTIMATES = 0x01, 0x02, 0x07, 0x09
SET_MODES, SET_POSITION, SET_VELOCITY, SET_TORQUE, SET_LIMITS = 0x0B, 0x0C, 0x0D, 0x0E, 0x0F
GET_IQ, CLEAR_ERRORS = 0x14, 0x18
OURS = frozenset({SET_STATE, SET_MODES, SET_POSITION, SET_VELOCITY, SET_TORQUE, SET_LIMITS})
"""Commands that only one master may send."""
KNOWN = OURS | {HEARTBEAT, ESTIMATES, GET_IQ}

# AXIS_STATE, then CONTROL_MODE, of ODrive's CAN protocol.
IDLE, CLOSED_LOOP = 1, 8
TORQUE_CONTROL, VELOCITY_CONTROL, POSITION_CONTROL = 1, 2, 3
PASSTHROUGH = 1  # INPUT_MODE of ODrive's CAN protocol: no filter of its own
WATCHDOG_EXPIRED = 0x800  # AXIS_ERROR of ODrive's CAN protocol
WORDS = {
    0x01: "invalid state asked for", 0x40: "motor failed", 0x80: "sensorless estimator failed",
    0x100: "encoder failed", 0x200: "controller failed", WATCHDOG_EXPIRED: "watchdog timer expired",
    0x1000: "minimum end switch pressed", 0x2000: "maximum end switch pressed",
    0x4000: "emergency stop asked for", 0x20000: "homing without end switch",
    0x40000: "over-temperature", 0x80000: "unknown position",
}  # fmt: skip
"""Bits of axis.error (fw-v0.5.4, AxisError)."""

INT16 = 2**15 - 1  # largest feed-forward that a frame holds, in its steps
FAILED = 0x01
"""Bit of the flags of motor, encoder and controller in the heartbeat."""

_two_floats = struct.Struct("<ff")
_state, _torque = struct.Struct("<I4x"), struct.Struct("<f4x")
_heartbeat = struct.Struct("<IBBBB")


class OdriveCodec:
    """One axis of an ODrive; positions in turns, torque by the motor's constant."""

    unit: AngleUnit = "turn"
    asks = False
    reports_time_out = True
    reach = math.inf

    def __init__(
        self, node_id: int, torque_constant: float, velocity_max: float, current_max: float
    ) -> None:
        self._base = node_id << 5
        self._torque_constant = torque_constant
        self._limits = self._frame(SET_LIMITS, _two_floats.pack(velocity_max, current_max))
        self._by_position = self._modes(POSITION_CONTROL)
        self._by_torque = self._modes(TORQUE_CONTROL)
        self._on = self._frame(SET_STATE, _state.pack(CLOSED_LOOP))
        self._off = self._frame(SET_STATE, _state.pack(IDLE))
        self._clear = self._frame(CLEAR_ERRORS, b"")
        self._goal: Frames = ()
        self._asked = self._given = self._taken = self._starved = False

    def _frame(self, command: int, data: bytes) -> Frame:
        return Frame(self._base | command, data)

    def _modes(self, control: int) -> Frame:
        return self._frame(SET_MODES, struct.pack("<ii", control, PASSTHROUGH))

    def opening(self) -> Frames:
        """Return IDLE, Clear_Errors and Set_Limits."""
        self._asked = self._given = self._taken = self._starved = False
        return self._off, self._clear, self._limits

    def enable(self, position: float) -> Frames:
        """Return Set_Controller_Mode, Set_Input_Pos and Set_Axis_State to closed loop.

        Clear_Errors comes before them where the watchdog has expired without power.
        """
        self._asked, self._taken = True, False
        return *self._forgiven(), self._by_position, *self.follow(position, 0.0), self._on

    def disable(self) -> Frames:
        """Return Set_Axis_State to idle, after Clear_Errors as `enable` does.

        Each message feeds the watchdog, so that an axis without power can be armed at any time.
        """
        self._taken = True
        return *self._forgiven(), self._off

    def _forgiven(self) -> Frames:
        return (self._clear,) if self._starved else ()

    def follow(self, position: float, velocity: float) -> Frames:
        """Return Set_Input_Pos with the velocity fed forward, in thousandths of a turn/s."""
        rate = max(-INT16, min(INT16, round(1e3 * velocity)))
        self._goal = (self._frame(SET_POSITION, struct.pack("<fhh", position, 0, 0)),)
        return (self._frame(SET_POSITION, struct.pack("<fhh", position, rate, 0)),)

    def brake(self) -> Frames:
        """Return Set_Input_Pos to the last goal, at rest: a reported position may be damaged."""
        return self._goal

    def push(self, torque: float) -> Frames:
        """Return Set_Controller_Mode and Set_Input_Torque."""
        return self._by_torque, self._frame(SET_TORQUE, _torque.pack(torque))

    def take(self, frame: Frame, report: Report) -> Taken:
        """Take heartbeat, encoder estimates and currents of our node."""
        command = frame.can_id & 0x1F
        if frame.extended or frame.can_id & ~0x1F != self._base or command not in KNOWN:
            return Taken.OTHER
        if command in OURS:
            return Taken.FOREIGN
        if len(frame.data) != _two_floats.size:
            return report.refuse("wrong_length")
        if command == HEARTBEAT:
            return self._take_heartbeat(frame.data, report)
        return self._take_measured(command, frame.data, report)

    def _take_measured(self, command: int, data: bytes, report: Report) -> Taken:
        first, second = _two_floats.unpack(data)
        if not (math.isfinite(first) and math.isfinite(second)):
            return report.refuse("not_a_number")
        if command == GET_IQ:
            report.torque = second * self._torque_constant
            return Taken.NOTED
        report.position = first
        report.velocity = second
        return Taken.MEASURED

    def _take_heartbeat(self, data: bytes, report: Report) -> Taken:
        error, state, motor, encoder, controller = _heartbeat.unpack(data)
        failed = bool((motor | encoder | controller) & FAILED)
        # Asked and seen: a heartbeat that was on its way reports the state before, of either.
        self._given |= self._asked and state == CLOSED_LOOP
        if state == IDLE and not error and self._taken:
            self._given = False
        self._starved = error == WATCHDOG_EXPIRED and not (failed or self._given)
        if self._starved and state == IDLE:
            report.state, report.complaint = DriveState.OFF, ""
        elif error or failed:
            report.state = DriveState.FAULT
            bits = [words for bit, words in WORDS.items() if error & bit]
            said = ", ".join(bits) or "see dump_errors of odrivetool"
            report.complaint = f"ODrive axis error 0x{error:X}: {said}"
        else:
            names = {IDLE: DriveState.OFF, CLOSED_LOOP: DriveState.FOLLOWING}
            report.state, report.complaint = names.get(state, DriveState.BUSY), ""
        return Taken.STATE
