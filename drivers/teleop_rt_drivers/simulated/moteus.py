"""A simulated moteus, by docs/protocol/can.md and registers.md of mjbots/moteus.

Nothing is shared with the driver. A screw of 10 mm turns its turns into the tool's metres; its
position loop is the plant's own.
"""

from __future__ import annotations

import math
import struct

from teleop_rt_drivers.simulated.makers_drive import MakersDrive

LEAD = 0.01
"""Rig units of position per turn."""
TORQUE_PER_FORCE = LEAD / 6.283185307179586  # Nm/N: rig units per radian
MODEL, FIRMWARE = 0x0105, 0x010304  # of the registers 0x100 and 0x101
WIDE, EXTENDED = 0x4000_0000, 0x8000_0000  # flags of a frame beside its id
DEFAULT_TIMEOUT_S = 0.1
"""`servo.default_timeout_s`, which a time-out of 0 or none means."""
FORMATS = ("b", "h", "i", "f")
WHOLE = {"b": 0, "h": 1, "i": 2}
TURNS, TURNS_PER_S, NM = (0.01, 1e-4, 1e-5), (0.1, 2.5e-4, 1e-5), (0.5, 0.01, 1e-3)
VOLTS, CELSIUS, SECONDS = (0.5, 0.1, 1e-3), (1.0, 0.1, 1e-3), (0.01, 1e-3, 1e-6)
SCALES = {"b": 1.0 / 127, "h": 1.0 / 32767, "i": 1.0 / (2**31 - 1)}
UNITS = {
    1: TURNS, 2: TURNS_PER_S, 3: NM, 0xD: VOLTS, 0xE: CELSIUS, 0x20: TURNS, 0x21: TURNS_PER_S,
    0x22: NM, 0x23: tuple(SCALES.values()), 0x24: tuple(SCALES.values()), 0x25: NM, 0x26: TURNS,
    0x27: SECONDS, 0x28: TURNS_PER_S,
}  # fmt: skip
"""Value of one count of a register as int8, int16 and int32; 1 for those that are not here."""
VOLTAGE, TEMPERATURE = 12.0, 20.0
"""V and degrees Celsius that it reports."""


class SimulatedMoteus(MakersDrive):
    """Modes stopped, position, fault and time-out; answers a frame that asks for it."""

    position_at = 7
    other_id = 0x100

    def _deliver(self) -> None:
        """Set the state in which the drive is delivered."""
        self._mode = self._fault = 0
        self._valid_until_ns = 0
        self._stands = False

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self._mode == 10

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self._mode == 10

    def restart(self) -> None:
        """Be as after power-on."""
        self._plant.power_off()
        self._mode = self._fault = 0

    def overheat(self) -> None:
        """Fail for being too hot."""
        self._fail(1, 38)

    def _fail(self, mode: int, fault: int) -> None:
        self._plant.power_off()
        self._mode, self._fault = mode, fault

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Obey the subframes in their order, and answer their questions."""
        if can_id & 0x7F != self._id:
            return
        answer, at = b"", 0
        commands: dict[int, float] = {}
        while at < len(data) and data[at] != 0x50:
            kind, count = data[at] & 0x3C, data[at] & 3
            at += 1
            if count == 0:
                count, at = data[at], at + 1
            start, at = data[at], at + 1
            if start & 0x80:
                start, at = start & 0x7F | data[at] << 7, at + 1
            code = FORMATS[kind >> 2 & 3]
            if kind < 0x10:
                layout = struct.Struct(f"<{count}{code}")
                values = layout.unpack_from(data, at)
                at += layout.size
                for register, value in enumerate(values, start):
                    commands[register] = register_value(register, code, value)
            elif kind < 0x20:
                if commands:
                    self._obey(commands, now_ns)
                    commands = {}
                answer += self._answered(kind, code, start, count)
        if commands:
            self._obey(commands, now_ns)
        if can_id & 0x8000:
            self._answer(answer)

    def _obey(self, commands: dict[int, float], now_ns: int) -> None:
        mode = commands.get(0, self._mode)
        if mode == 0:
            self.restart()
            return
        if mode != 10 or self._mode in (1, 11):
            return
        if self.refuses:
            self._fail(1, 36)
            return
        if self._mode != 10:
            self._mode = 10
            self._plant.hold()
        valid_s = commands.get(0x27, 0.0) or DEFAULT_TIMEOUT_S
        self._valid_until_ns = now_ns + (2**62 if math.isnan(valid_s) else round(valid_s * 1e9))
        self._move(commands)

    def _move(self, commands: dict[int, float]) -> None:
        """Act as in position mode; the scale of kd counts up to that of kp alone."""
        position = commands.get(0x20, 0.0)
        stood, self._stands = self._stands, math.isnan(position)
        if commands.get(0x23, 1.0) == 0.0:
            self._stands = False
            self._plant.push(commands.get(0x22, 0.0) / TORQUE_PER_FORCE)
        elif not self._stands:
            self._plant.follow(position * LEAD, self._period_s)
        elif not stood:
            self._plant.hold()

    def _answered(self, kind: int, code: str, start: int, count: int) -> bytes:
        torque = self._plant.servo_force * TORQUE_PER_FORCE if self.enabled else 0.0
        registers = {
            0: self._mode,
            1: self._plant.reported_position / LEAD,
            2: self._plant.velocity / LEAD,
            3: torque,
            0xD: VOLTAGE,
            0xE: TEMPERATURE,
            0xF: self._fault,
            0x100: MODEL,
            0x101: FIRMWARE,
        }
        values = [registers[register] for register in range(start, start + count)]
        if code != "f":
            values = [
                round(value / unit_of(register, code))
                for register, value in enumerate(values, start)
            ]
        place = bytes((start,)) if start < 0x80 else bytes((start & 0x7F | 0x80, start >> 7))
        head = bytes((kind + 0x10 + count,) if count < 4 else (kind + 0x10, count))
        return head + place + struct.pack(f"<{count}{code}", *values)

    def _answer(self, answer: bytes) -> None:
        size = next(size for size in (8, 12, 16, 20, 24, 32, 48, 64) if size >= len(answer))
        can_id = self._id << 8
        mark = WIDE | (EXTENDED if can_id > 0x7FF else 0)
        self._send(mark | can_id, answer.ljust(size, b"\x50"))

    def run(self, now_ns: int) -> bool:
        """Time out when a command is valid no longer."""
        if self.enabled and now_ns > self._valid_until_ns:
            self._fail(11, 0)
        return False

    def due_ns(self, now_ns: int) -> int:
        """Return a time soon enough for the watchdog."""
        return now_ns + 5_000_000


def unit_of(register: int, code: str) -> float:
    """Return the value of a count of a register in a format of whole numbers."""
    return UNITS[register][WHOLE[code]] if register in UNITS else 1.0


def register_value(register: int, code: str, value: float) -> float:
    """Return the value of a register in its unit; not a number for the least whole number."""
    if code == "f":
        return value
    if value == -(2 ** (8 * struct.calcsize(code) - 1)):
        return math.nan
    return value * unit_of(register, code)
