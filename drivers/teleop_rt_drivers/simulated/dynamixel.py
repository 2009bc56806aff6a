"""A simulated Dynamixel of the X series, by ROBOTIS' e-manual: protocol 2 and control table.

Nothing is shared with the driver. Its table is a row of bytes as the manual lists them, with
indirect addresses; its position loop is the plant's own, and a pinion turns its turns into metres.
"""

from __future__ import annotations

import struct

from teleop_rt_drivers.simulated.makers_drive import MakersDrive

CURRENT_NS = 4_000_000
"""Over so long the current that it reports is averaged: longer than between two goals."""
CIRCUMFERENCE = 0.1
"""Rig units of position per turn."""
TORQUE_PER_FORCE = CIRCUMFERENCE / 6.283185307179586  # Nm/N: rig units per radian
TORQUE_PER_COUNT = 2.0 * 0.00269
"""2 Nm per ampere, 2.69 mA per count."""
TABLE_BYTES = 256  # past the last register that is used
EEPROM_ENDS = 64  # by the control table of the X series
MODEL, FIRMWARE = 1030, 48  # an XM430-W210, and its firmware's version
STEP_NS = 20_000_000
"""Unit of the bus watchdog."""
CHECKED = ((116, 4, 1_048_575), (102, 2, 1193))
"""Registers of a range: address, size, largest amount."""


class SimulatedDynamixel(MakersDrive):
    """Torque off and on, hardware errors that a reboot alone ends, a bus watchdog."""

    position_at = 11
    other_id = 0x40

    def _deliver(self) -> None:
        """Set the state in which the drive is delivered."""
        self._table = bytearray(TABLE_BYTES)
        self._heard_ns = 0
        self._begun = b""
        self._eeprom()
        self.restart()

    def _eeprom(self) -> None:
        """Fill in the values that stay without power, as delivered."""
        self._table[0:2], self._table[6], self._table[7] = struct.pack("<H", MODEL), FIRMWARE, 1
        self._table[7], self._table[9], self._table[11] = self._id, 0, 3
        self._table[38:40], self._table[44:48] = struct.pack("<H", 1193), struct.pack("<I", 1023)

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self.powered and self._table[98] != 0xFF

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self._table[64] == 1

    def restart(self) -> None:
        """Be as after power-on."""
        self._plant.power_off()
        self._table[EEPROM_ENDS:] = bytes(TABLE_BYTES - EEPROM_ENDS)
        self._table[68] = 2
        self._table[168:224] = struct.pack("<28H", *range(224, 252))

    def overheat(self) -> None:
        """Fail for being too hot."""
        self._table[70] |= 0x04
        self._torque(0)

    def _torque(self, value: int) -> None:
        if value and (self.refuses or self._table[70]):
            return
        if value and not self.powered:
            self._plant.hold()
        elif not value:
            self._plant.power_off()
        self._table[64] = value

    def packed(self, whom: int, content: bytes) -> bytes:
        """Return a status packet, stuffed, with its CRC."""
        body, ones = bytearray(b"\x55"), b"\xff\xff\xfd"
        for byte in content:
            body.append(byte)
            if body[-3:] == ones:
                body.append(0xFD)
        packet = bytes((0xFF, 0xFF, 0xFD, 0, whom, (len(body) + 2) & 0xFF, 0)) + bytes(body)
        return packet + struct.pack("<H", remainder(packet))

    def receive(self, data: bytes, now_ns: int) -> bool:
        """Obey each whole packet; return whether a position was asked for."""
        self._begun += data
        measured = False
        while (at := self._begun.find(b"\xff\xff\xfd\x00")) >= 0:
            rest = self._begun[at:]
            if len(rest) < 7 or len(rest) < (size := 7 + rest[5] + 256 * rest[6]):
                break
            packet, self._begun = rest[:size], rest[size:]
            if remainder(packet[:-2]) == packet[-2] + 256 * packet[-1]:
                self._heard_ns = now_ns
                measured = self._obey(packet[4], packet[7:-2]) or measured
        return measured

    def _obey(self, whom: int, stuffed: bytes) -> bool:
        content = stuffed.replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        instruction, parameters = content[0], content[1:]
        if instruction == 0x82 and whom == 0xFE:
            address, size = struct.unpack("<HH", parameters[:4])
            if self._id in parameters[4:] and self._table[68] >= 1:
                self._answer(0, self._read(address, size))
                return True
        elif instruction == 0x83 and whom == 0xFE:
            address, size = struct.unpack("<HH", parameters[:4])
            for place in range(4, len(parameters), 1 + size):
                if parameters[place] == self._id:
                    self._write(address, parameters[place + 1 : place + 1 + size])
        elif whom in {self._id, 0xFE} and instruction == 0x01:
            self._answer(0, self._read(0, 2) + self._read(6, 1))
        elif whom == self._id and instruction == 0x02:
            address, size = struct.unpack("<HH", parameters)
            self._answer(0, self._read(address, size))
            return True
        elif whom == self._id and instruction == 0x08:
            self.restart()
            self._answer(0, b"")
        return False

    def _answer(self, error: int, registers: bytes) -> None:
        self._send(self._id, bytes((error | (0x80 if self._table[70] else 0),)) + registers)

    def _read(self, address: int, size: int) -> bytes:
        plant = self._plant
        torque = plant.mean_servo_force(CURRENT_NS) * TORQUE_PER_FORCE if self.powered else 0.0
        rpm = 60.0 * plant.velocity / CIRCUMFERENCE
        counts = 4096.0 * plant.reported_position / CIRCUMFERENCE
        struct.pack_into("<hii", self._table, 126, round(torque / TORQUE_PER_COUNT),
                         round(rpm / 0.229), round(counts))  # fmt: skip
        return bytes(self._table[self._place(address + k)] for k in range(size))

    def _place(self, address: int) -> int:
        """Return where a register really is: indirect data stand where their addresses say."""
        if not 224 <= address < 252:
            return address
        at = 168 + 2 * (address - 224)
        return int.from_bytes(self._table[at : at + 2], "little")

    def _write(self, address: int, data: bytes) -> None:
        locked = self.powered and address < EEPROM_ENDS
        stopped = self._table[98] == 0xFF and address in (100, 102, 104, 116)
        if locked or stopped or not self._within(address, data):
            return
        if address == 64:
            self._torque(data[0])
            return
        self._table[address : address + len(data)] = data
        if address == 116 and self.enabled and self._table[11] in (3, 4, 5):
            counts = int.from_bytes(data, "little", signed=True)
            self._plant.follow(counts * CIRCUMFERENCE / 4096.0, self._period_s)

    @staticmethod
    def _within(address: int, data: bytes) -> bool:
        for register, size, most in CHECKED:
            if address == register:
                value = int.from_bytes(data, "little", signed=True)
                return len(data) == size and abs(value) <= most
        return True

    def run(self, now_ns: int) -> bool:
        """Stop where no packet has come for as long as the watchdog waits."""
        steps = self._table[98]
        if self.powered and 0 < steps < 128 and now_ns - self._heard_ns > steps * STEP_NS:
            self._table[98] = 0xFF
            self._plant.hold()
        return False

    def due_ns(self, now_ns: int) -> int:
        """Return a time soon enough for the watchdog."""
        return now_ns + 5_000_000


def remainder(data: bytes) -> int:
    """Return the CRC-16 of polynomial x^16 + x^15 + x^2 + 1, bit by bit."""
    value = 0
    for bit in "".join(f"{byte:08b}" for byte in data):
        over = value >> 15 ^ int(bit)
        value = value << 1 & 0xFFFF
        if over:
            value ^= 0x8005
    return value
