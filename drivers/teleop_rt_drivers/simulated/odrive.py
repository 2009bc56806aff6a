"""A simulated axis of an ODrive on CANSimple, by its maker's table of messages.

Made from odriverobotics/ODrive, docs/can-protocol.rst and can-protocol.csv, byte by byte; its
behaviour from its Firmware (can_simple.cpp, axis.cpp, main.cpp); nothing is shared with the driver.
Set up as `docs/howto/odrive.md` says: heartbeat every 10 ms, encoder estimates and currents every
millisecond, a watchdog of 50 ms that every message to the axis feeds, and that runs in any state.
"""

from __future__ import annotations

import struct

from teleop_rt_drivers.simulated.makers_drive import MakersDrive

LEAD = 0.01
"""Rig units of position per turn: a screw of 10 mm."""
TORQUE_PER_FORCE = LEAD / 6.283185307179586  # Nm/N: rig units per radian
TORQUE_CONSTANT = 0.05
"""Nm/A."""
HEARTBEAT_NS, ENCODER_NS, WATCHDOG_NS = 10_000_000, 1_000_000, 50_000_000
"""Periods of its messages, and its watchdog, as the rig's file has them."""
# AXIS_STATE, then AXIS_ERROR, of ODrive's CAN protocol.
IDLE, CLOSED_LOOP = 1, 8
INVALID_STATE, MOTOR_FAILED, WATCHDOG_EXPIRED, OVER_TEMPERATURE = 0x1, 0x40, 0x800, 0x40000


class SimulatedOdrive(MakersDrive):
    """An axis: idle, closed loop, errors that stay until they are cleared."""

    id_key = "node_id"
    position_at = 0
    other_id = 0x100

    def _deliver(self) -> None:
        """Set the state in which the drive is delivered."""
        self._state, self._error = IDLE, 0
        self._control_mode = 3
        self._fed_ns = self._heartbeat_ns = self._encoder_ns = 0

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self._state == CLOSED_LOOP

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self._state == CLOSED_LOOP

    def restart(self) -> None:
        """Be as after power-on."""
        self._plant.power_off()
        self._state, self._error = IDLE, 0

    def overheat(self) -> None:
        """Fail for being too hot."""
        self._fail(MOTOR_FAILED | OVER_TEMPERATURE)

    def _fail(self, error: int) -> None:
        self._error |= error
        self._state = IDLE
        self._plant.power_off()

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Obey a message to our node."""
        if can_id >> 5 != self._id:
            return
        self._fed_ns = now_ns
        command = can_id & 31
        if command == 0x07 and len(data) >= 4:
            self._ask_state(int.from_bytes(data[:4], "little"))
        elif command == 0x0B and len(data) == 8:
            self._control_mode = int.from_bytes(data[:4], "little")
        elif command == 0x0C and len(data) == 8 and self.enabled and self._control_mode == 3:
            (turns,) = struct.unpack("<f", data[:4])
            self._plant.follow(turns * LEAD, self._period_s)
        elif command == 0x0E and len(data) >= 4 and self.enabled and self._control_mode == 1:
            (torque,) = struct.unpack("<f", data[:4])
            self._plant.push(torque / TORQUE_PER_FORCE)
        elif command == 0x02:
            self._fail(0x4000)
        elif command == 0x18:
            self._error = 0

    def _ask_state(self, state: int) -> None:
        self._error &= ~INVALID_STATE  # any new request clears that of the last
        if state == IDLE:
            self._state = IDLE
            self._plant.power_off()
        elif state == CLOSED_LOOP and not self.enabled:
            if self.refuses or self._error:
                self._fail(INVALID_STATE)
            else:
                self._state = CLOSED_LOOP
                self._plant.hold()

    def run(self, now_ns: int) -> bool:
        """Watch, and send the due frames."""
        if now_ns - self._fed_ns > WATCHDOG_NS:
            self._fail(WATCHDOG_EXPIRED)
        if now_ns - self._heartbeat_ns >= HEARTBEAT_NS:
            self._heartbeat_ns = now_ns
            self._beat()
        if now_ns - self._encoder_ns < ENCODER_NS:
            return False
        late = now_ns - self._encoder_ns >= 2 * ENCODER_NS
        self._encoder_ns = now_ns if late else self._encoder_ns + ENCODER_NS
        current = self._plant.servo_force * TORQUE_PER_FORCE / TORQUE_CONSTANT
        self._send(self._id * 32 + 20, struct.pack("<f", current) * 2)
        turns, rate = self._plant.reported_position / LEAD, self._plant.velocity / LEAD
        self._send(self._id * 32 + 9, struct.pack("<ff", turns, rate))
        return True

    def _beat(self) -> None:
        error, motor = self._error.to_bytes(4, "little"), self._error & MOTOR_FAILED != 0
        self._send(self._id * 32 + 1, error + bytes((self._state, motor, 0, 0)))

    def due_ns(self, now_ns: int) -> int:  # noqa: ARG002 - others' depends on it
        """Return when the next estimates are sent."""
        return self._encoder_ns + ENCODER_NS
