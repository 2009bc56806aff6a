"""A simulated Feetech servo of the STS series, by its maker's memory table.

Nothing is shared with the driver. Its position loop is the plant's own, and a pinion turns its
turns into metres. It has no watchdog: without a master it goes on holding its last goal.
"""

from __future__ import annotations

import struct

from teleop_rt_drivers.simulated.makers_drive import MakersDrive

CURRENT_NS = 4_000_000
"""Over so long the current that it reports is averaged: longer than between two goals."""
CIRCUMFERENCE = 0.1
"""Rig units of position per turn."""
TORQUE_PER_FORCE = CIRCUMFERENCE / 6.283185307179586  # Nm/N: rig units per radian
TORQUE_PER_COUNT = 2.0 * 0.0065
"""2 Nm per ampere, 6.5 mA per count."""
TABLE_BYTES = 87  # by the memory table of the STS series
SRAM = 40  # first register that is lost without power


class SimulatedFeetech(MakersDrive):
    """Torque off and on, a goal, and errors that stay until it is restarted."""

    position_at = 17
    other_id = 0x40

    def _deliver(self) -> None:
        """Set the state in which the drive is delivered."""
        self._table = bytearray(TABLE_BYTES)
        self._begun = b""
        self._table[5], self._table[8], self._table[18] = self._id, 1, 0b0001_0100
        self._table[16:18] = struct.pack("<H", 1000)
        self.restart()

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self.powered

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self._table[40] == 1

    def restart(self) -> None:
        """Be as after power-on."""
        self._plant.power_off()
        self._table[SRAM:] = bytes(TABLE_BYTES - SRAM)
        self._table[48:50], self._table[55] = self._table[16:18], 1

    def overheat(self) -> None:
        """Fail for being too hot."""
        self._table[65] |= 0x04
        self._torque(0)

    def _torque(self, value: int) -> None:
        if value and (self.refuses or self._table[65]):
            return
        if value and not self.powered:
            self._plant.hold()
        elif not value:
            self._plant.power_off()
        self._table[40] = value

    def packed(self, whom: int, content: bytes) -> bytes:
        """Return a status packet with its checksum."""
        body = bytes((whom, len(content) + 1)) + content
        return b"\xff\xff" + body + bytes((255 - sum(body) % 256,))

    def receive(self, data: bytes, now_ns: int) -> bool:  # noqa: ARG002 - it watches nobody
        """Obey each whole packet; return whether a position was asked for."""
        self._begun += data
        measured = False
        while (at := self._begun.find(b"\xff\xff")) >= 0:
            rest = self._begun[at:]
            if len(rest) < 4 or len(rest) < 4 + rest[3]:
                break
            packet, self._begun = rest[: 4 + rest[3]], rest[4 + rest[3] :]
            if sum(packet[2:]) % 256 == 255:
                measured = self._obey(packet[2], packet[4], packet[5:-1]) or measured
        return measured

    def _obey(self, whom: int, instruction: int, parameters: bytes) -> bool:
        if whom == 0xFE and instruction == 0x82:
            address, size, *ids = parameters
            if self._id in ids:
                self._answer(address, size)
                return True
        elif whom == 0xFE and instruction == 0x83:
            address, size = parameters[:2]
            for place in range(2, len(parameters), 1 + size):
                if parameters[place] == self._id:
                    self._write(address, parameters[place + 1 : place + 1 + size])
        elif whom == self._id and instruction == 0x01:
            self._send(self._id, bytes((self._table[65],)))
        elif whom == self._id and instruction == 0x02:
            self._answer(parameters[0], parameters[1])
            return True
        return False

    def _answer(self, address: int, size: int) -> None:
        plant = self._plant
        torque = plant.mean_servo_force(CURRENT_NS) * TORQUE_PER_FORCE if self.powered else 0.0
        amount = round(abs(torque) / TORQUE_PER_COUNT)
        steps_per_s = 4096.0 * plant.velocity / CIRCUMFERENCE
        counts = 4096.0 * plant.reported_position / CIRCUMFERENCE
        struct.pack_into("<HHH", self._table, 56, with_sign(counts, 15), with_sign(steps_per_s, 15),
                         1 << 10 if torque < 0 else 0)  # fmt: skip
        struct.pack_into("<H", self._table, 69, amount)
        registers = bytes(self._table[address : address + size])
        self._send(self._id, bytes((self._table[65],)) + registers)

    def _write(self, address: int, data: bytes) -> None:
        for place, value in enumerate(data):
            register = address + place
            if register == 40:
                self._torque(value)
            elif register < 56:
                self._table[register] = value
        if address <= 42 < address + len(data) and self.powered:
            goal = int.from_bytes(self._table[42:44], "little")
            counts = goal if goal < 0x8000 else 0x8000 - goal
            self._plant.follow(counts * CIRCUMFERENCE / 4096.0, self._period_s)

    def run(self, now_ns: int) -> bool:  # noqa: ARG002 - nothing is due by itself
        """Do nothing: it speaks when it is asked."""
        return False

    def due_ns(self, now_ns: int) -> int:
        """Return a time soon enough for the plant to run on."""
        return now_ns + 5_000_000


def with_sign(value: float, bit: int) -> int:
    """Return an amount with its sign in a bit of its own."""
    return min(round(abs(value)), (1 << bit) - 1) | (1 << bit if value < 0 else 0)
