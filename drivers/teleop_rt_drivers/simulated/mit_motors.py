"""Simulated motors with an impedance loop: Damiao, and CyberGear with RobStride.

Made from the makers' documents, bit by bit (see `actuators/mit.py` for which); nothing is shared
with the driver. A pinion of 10 mm turns the motor's radians into the tool's metres.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.actuators.part import ActuatorPart
    from teleop_rt_drivers.simulated.plant import Plant

    Send = Callable[[int, bytes], None]

RADIUS = 0.01
"""Rig units of position per radian."""
TIMEOUT_NS = 50_000_000
"""Time without a command after which the motor lets go, as its maker's tool sets it."""
EXTENDED = 0x8000_0000  # CAN_EFF_FLAG of linux/can.h
# Ranges of position [rad], velocity [rad/s] and torque [Nm] of the motors that are simulated.
DM4310 = (12.5, 30.0, 10.0)
ROBSTRIDE_02 = (12.566370614359172, 44.0, 17.0)
CYBERGEAR = (12.566370614359172, 30.0, 12.0)


def as_number(value: float, top: float, most: int) -> int:
    """Return a value of a range symmetric about 0 as 0 to `most`."""
    return max(0, min(most, int((value + top) / (2.0 * top) * most + 0.5)))


def as_value(number: int, top: float, most: int) -> float:
    """Return the value of a code of 0 to `most`."""
    return number / most * 2.0 * top - top


class Motor:
    """A motor's loop on the plant, and the watch over its commands."""

    timeout_ns = TIMEOUT_NS
    position_at = 0
    other_id = 0x100

    def __init__(
        self, config: ActuatorPart, plant: Plant, send: Send, period_ns: int,
        tops: tuple[float, float, float],
    ) -> None:  # fmt: skip
        settings = config.model_dump()
        self.refuses = False
        self.enabled = False
        self.fault = 0
        self.motor_id, self.host_id = int(settings["motor_id"]), int(settings["host_id"])
        self.plant = plant
        self.send = send
        self.tops = tops
        self._period_s = period_ns * 1e-9
        self._heard_ns = 0

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self.enabled

    def restart(self) -> None:
        """Be as after power-on."""
        self.let_go()
        self.fault = 0

    def let_go(self) -> None:
        """Take the motor's voltage away."""
        self.enabled = False
        self.plant.power_off()

    def hold(self) -> None:
        """Give the motor voltage, unless it refuses or has failed."""
        if not self.refuses and not self.fault and not self.enabled:
            self.enabled = True
            self.plant.push(0.0)

    def heard(self, now_ns: int) -> None:
        """Note a command."""
        self._heard_ns = now_ns

    def act(self, p: float, v: float, kp: float, kd: float, t: float) -> None:
        """Push kp (p - x) + kd (v - x') + t."""
        if not self.enabled:
            return
        stiffness, damping = kp / RADIUS**2, kd / RADIUS**2
        if kp > 0.0:
            self.plant.impede(p * RADIUS, v * RADIUS, stiffness, damping, self._period_s)
        elif kd > 0.0:
            x = self.plant.position
            self.plant.impede(x, v * RADIUS, 0.0, damping, self._period_s)
        else:
            self.plant.push(t / RADIUS)

    def measured(self) -> tuple[float, float, float]:
        """Return position [rad], velocity [rad/s] and torque [Nm]."""
        force = self.plant.servo_force if self.enabled else 0.0
        return self.plant.reported_position / RADIUS, self.plant.velocity / RADIUS, force * RADIUS

    def run(self, now_ns: int) -> bool:
        """Let go when commands stay away."""
        if self.enabled and now_ns - self._heard_ns > self.timeout_ns:
            self.timed_out()
        return False

    def timed_out(self) -> None:
        """Remove the motor's power after a command timeout."""
        self.let_go()

    def due_ns(self, now_ns: int) -> int:
        """Return a time soon enough for the watch."""
        return now_ns + 5_000_000


class SimulatedDamiao(Motor):
    """Commands under the motor's id, answers under MST_ID."""

    position_at = 1

    def overheat(self) -> None:
        """Fail for hot coils."""
        self.fault = 0xC
        self.let_go()

    def timed_out(self) -> None:
        """Report lost communication."""
        self.fault = 0xD
        self.let_go()

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Obey a command, and answer it; under 7FFh registers and the status are asked for."""
        if can_id == 0x7FF and data[:3] == struct.pack("<HB", self.motor_id, 0xCC):
            self._answer()
        if can_id == 0x7FF and data[:3] == struct.pack("<HB", self.motor_id, 0x33):
            self._say(data[3])
        if can_id != self.motor_id or len(data) != 8:
            return
        self.heard(now_ns)
        if data[:7] == b"\xff\xff\xff\xff\xff\xff\xff" and data[7] >= 0xFB:
            if data[7] == 0xFC:
                self.hold()
            elif data[7] == 0xFD:
                self.let_go()
            elif data[7] == 0xFB:
                self.fault = 0
        else:
            p = as_value(data[0] << 8 | data[1], self.tops[0], 65535)
            v = as_value(data[2] << 4 | data[3] >> 4, self.tops[1], 4095)
            kp = ((data[3] & 15) << 8 | data[4]) / 4095 * 500.0
            kd = (data[5] << 4 | data[6] >> 4) / 4095 * 5.0
            t = as_value((data[6] & 15) << 8 | data[7], self.tops[2], 4095)
            self.act(p, v, kp, kd, t)
        self._answer()

    def _say(self, register: int) -> None:
        """Answer a register: ids as whole numbers, ranges as floats."""
        held = {7: struct.pack("<I", self.host_id), 8: struct.pack("<I", self.motor_id)}
        held |= {21 + place: struct.pack("<f", top) for place, top in enumerate(self.tops)}
        if register in held:
            head = struct.pack("<HBB", self.motor_id, 0x33, register)
            self.send(self.host_id, head + held[register])

    def _answer(self) -> None:
        position, velocity, torque = self.measured()
        p = as_number(position, self.tops[0], 65535)
        v = as_number(velocity, self.tops[1], 4095)
        t = as_number(torque, self.tops[2], 4095)
        code = self.fault or int(self.enabled)
        body = [
            self.motor_id & 15 | code << 4, p >> 8, p & 255, v >> 4, (v & 15) << 4 | t >> 8,
            t & 255, 31, 33,
        ]  # fmt: skip
        self.send(self.host_id, bytes(body))


class SimulatedTyped(Motor):
    """CyberGear and RobStride: the kind of communication is in the id."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]  # as a motor's
        self.timeout_ns = 2**62
        self.run_mode = 0

    def restart(self) -> None:
        """Be as after power-on: in operation control mode, and without a time-out."""
        super().restart()
        self.timeout_ns, self.run_mode = 2**62, 0

    def overheat(self) -> None:
        """Fail for being too hot, and say so in a message of its own (type 21)."""
        self.fault = 4
        self.let_go()
        can_id = 21 << 24 | self.host_id << 8 | self.motor_id
        self.send(EXTENDED | can_id, struct.pack("<II", 1, 1))

    def receive(self, can_id: int, data: bytes, now_ns: int) -> None:
        """Obey a command, and answer it."""
        if can_id & 255 != self.motor_id:
            return
        if can_id >> 24 == 0:
            self.send(EXTENDED | self.motor_id << 8 | 0xFE, b"\x31\x39\x03\x35\x31\x70\x26\x30")
            return
        self.heard(now_ns)
        kind, middle = can_id >> 24, can_id >> 8 & 0xFFFF
        if kind == 1 and len(data) == 8:
            p, v, kp, kd = (int.from_bytes(data[at : at + 2], "big") for at in range(0, 8, 2))
            self.act(
                as_value(p, self.tops[0], 65535), as_value(v, self.tops[1], 65535),
                kp / 65535 * 500.0, kd / 65535 * 5.0, as_value(middle, self.tops[2], 65535),
            )  # fmt: skip
        elif kind == 3 and self.run_mode == 0:
            self.hold()
        elif kind == 4:
            self.let_go()
            self.fault = 0 if data[:1] == b"\x01" else self.fault
        elif kind == 18:
            self._write(int.from_bytes(data[:2], "little"), data[4:])
        elif kind == 17:
            self._read(int.from_bytes(data[:2], "little"))
        if kind in (1, 3, 4, 18):
            self._answer()

    def _read(self, index: int) -> None:
        """Answer a parameter; one that this motor does not have with an error."""
        turned = self.plant.reported_position / RADIUS
        held = {0x7005: struct.pack("<Bxxx", self.run_mode), 0x7019: struct.pack("<f", turned)}
        can_id = 17 << 24 | (index not in held) << 16 | self.motor_id << 8 | self.host_id
        self.send(EXTENDED | can_id, struct.pack("<HH", index, 0) + held.get(index, bytes(4)))

    def _write(self, index: int, value: bytes) -> None:
        if index == 0x7005:
            self.run_mode = value[0]
        elif index == 0x7028 and self.tops != CYBERGEAR:  # whose manual has no time-out
            self.timeout_ns = int.from_bytes(value, "little") * 50_000

    def _answer(self) -> None:
        position, velocity, torque = self.measured()
        numbers = [
            as_number(value, top, 65535)
            for value, top in zip((position, velocity, torque), self.tops, strict=True)
        ]
        mode = 2 if self.enabled else 0
        can_id = 2 << 24 | mode << 22 | self.fault << 16 | self.motor_id << 8 | self.host_id
        self.send(EXTENDED | can_id, struct.pack(">HHHH", *numbers, 312))


def simulated_motor(
    config: ActuatorPart, plant: Plant, send: Send, period_ns: int
) -> SimulatedDamiao | SimulatedTyped:
    """Return the motor that the config names; one without a model raises KeyError."""
    name = str(config.model_dump()["motor"])
    if name == "DM4310":
        return SimulatedDamiao(config, plant, send, period_ns, DM4310)
    tops = {"robstride02": ROBSTRIDE_02, "cybergear": CYBERGEAR}[name]
    return SimulatedTyped(config, plant, send, period_ns, tops)
