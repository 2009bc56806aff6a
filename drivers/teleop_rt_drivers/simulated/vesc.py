"""A simulated VESC, by documentation/comm_can.md of vedderb/bldc.

Nothing is shared with the driver. Set up as `docs/howto/vesc.md` says: status messages 1 and 4
each millisecond, a time-out of 50 ms after which the motor is let go. A belt moves the tool.
"""

from __future__ import annotations

import struct

from teleop_rt_drivers.simulated.makers_drive import MakersDrive

PER_TURN = 0.2
"""Rig units of position per turn of the position; its middle, 180 degrees, is 0."""
MOTOR_TURNS, POLE_PAIRS, TORQUE_CONSTANT = 4.0, 7, 0.06
"""Turns of the motor per turn of the position, its pole pairs, and Nm/A."""
FORCE_PER_AMPERE = TORQUE_CONSTANT * MOTOR_TURNS * 6.283185307179586 / PER_TURN
"""N/A at the handle."""
STATUS_NS, TIMEOUT_NS = 1_000_000, 50_000_000
"""Period of its status, and the time without a command after which it lets go."""
COLD, HOT = 250, 1250
"""Tenths of a degree Celsius."""
EXTENDED = 0x8000_0000  # CAN_EFF_FLAG of linux/can.h


class SimulatedVesc(MakersDrive):
    """Follows the last command, lets go after its time-out, and reports no fault."""

    id_key = "controller_id"
    position_at = 6
    other_id = 0x40

    def _deliver(self) -> None:
        """Set the state in which the drive is delivered."""
        self._mode = "let go"
        self._temperature = COLD
        self._heard_ns = self._sent_ns = 0

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self._mode != "let go"

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self._mode != "let go"

    def restart(self) -> None:
        """Be as after power-on."""
        self._temperature = COLD
        self._let_go()

    def overheat(self) -> None:
        """Fail for being too hot."""
        self._temperature = HOT
        self._let_go()

    def _let_go(self) -> None:
        self._mode = "let go"
        self._plant.power_off()

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Obey a command for us; each of them puts the time-out off."""
        if can_id == 17 << 8 | self._id and len(data) == 1:
            self._send(EXTENDED | 18 << 8 | data[0], bytes((self._id, 0)))
        if can_id & 0xFF != self._id or len(data) < 4:
            return
        self._heard_ns = now_ns
        command, value = can_id >> 8, int.from_bytes(data[:4], "big", signed=True)
        if self.refuses or self._temperature == HOT:
            self._let_go()
        elif command == 4:
            if self._mode != "position":
                self._plant.hold()
                self._mode = "position"
            self._plant.follow((value / 1e6 - 180.0) / 360.0 * PER_TURN, self._period_s)
        elif command == 1 and value:
            self._mode = "current"
            self._plant.push(value / 1e3 * FORCE_PER_AMPERE)
        elif command == 1:
            self._let_go()

    def run(self, now_ns: int) -> bool:
        """Let go after the time-out, and send the due frames."""
        if self.enabled and now_ns - self._heard_ns > TIMEOUT_NS:
            self._let_go()
        if now_ns - self._sent_ns < STATUS_NS:
            return False
        late = now_ns - self._sent_ns >= 2 * STATUS_NS
        self._sent_ns = now_ns if late else self._sent_ns + STATUS_NS
        erpm = self._plant.velocity / PER_TURN * MOTOR_TURNS * POLE_PAIRS * 60.0
        force = self._plant.servo_force if self.enabled else 0.0
        self._report(9, struct.pack(">ihh", round(erpm), round(10 * force / FORCE_PER_AMPERE), 0))
        degrees = 180.0 + 360.0 * self._plant.reported_position / PER_TURN
        self._report(16, struct.pack(">hhhh", self._temperature, COLD, 0, round(50 * degrees)))
        return True

    def _report(self, command: int, data: bytes) -> None:
        self._send(EXTENDED | command * 256 + self._id, data)

    def due_ns(self, now_ns: int) -> int:  # noqa: ARG002 - others' depends on it
        """Return when the next status is sent."""
        return self._sent_ns + STATUS_NS
