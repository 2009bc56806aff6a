"""Makers' drives on a CAN bus: each protocol's own question for who is there.

ODrive and VESC say so by themselves or when pinged, Damiao when a register is read (`DM_CAN.py`),
CyberGear and RobStride by communication type 0, moteus when its id is queried (`registers.md`).
Nothing that is sent gives power, moves, or writes.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

import can

from teleop_rt.axis import AxisError
from teleop_rt_drivers.actuators.mit import DAMIAO_RANGES
from teleop_rt_drivers.scanning.found import Found

if TYPE_CHECKING:
    from collections.abc import Callable

LISTEN_S = 1.2
"""Longer than a heartbeat's usual period of 0.1 s, and than a slow one of 1 s."""
ANSWER_S = 0.004
"""For the answer to a question; an adapter on USB keeps it for a millisecond or two."""
OWN_ID = 0xFD  # the host's, by RobStride's protocol
DAMIAO_REGISTERS, MST_ID, PMAX, VMAX, TMAX = 0x7FF, 7, 21, 22, 23  # an id, and registers
READ = 0x33  # command "read register" of Damiao's protocol
# A bit of the id, a register, two subframes; then VESC's ping and its answer.
MOTEUS_WANTED, MODEL, READ_INT32, REPLY_INT32 = 0x8000, 0x100, 0x18, 0x28
PING, PONG = 17, 18


class CanScan:
    """Asks on a bus that it does not own, and hears the answers."""

    def __init__(self, bus: can.BusABC, now_ns: Callable[[], int]) -> None:
        self._bus = bus
        self._now_ns = now_ns

    def listen(self, seconds: float, take: Callable[[can.Message], object]) -> None:
        """Yield the frames that come in this time."""
        end_ns = self._now_ns() + round(1e9 * seconds)
        while (left_ns := end_ns - self._now_ns()) > 0:
            try:
                frame = self._bus.recv(left_ns * 1e-9)
            except (can.CanError, OSError) as error:
                raise AxisError(f"the bus fails: {error}; check adapter and wiring") from error
            if frame is None:
                return
            if not frame.is_error_frame and not frame.is_remote_frame:
                take(frame)

    def ask(self, frame: can.Message, take: Callable[[can.Message], object]) -> None:
        """Send a question, and yield the frames that may be answers."""
        try:
            self._bus.send(frame, 0.1)
        except (can.CanError, OSError) as error:
            raise AxisError(
                f"the bus refuses to send: {error}; nothing acknowledges: check power, "
                "termination and bit rate"
            ) from error
        self.listen(ANSWER_S, take)


def odrives(scan: CanScan) -> list[Found]:
    """Return the axes whose heartbeat (command 01h of CANSimple) is heard."""
    nodes: set[int] = set()

    def take(frame: can.Message) -> None:
        if not frame.is_extended_id and frame.arbitration_id & 0x1F == 1 and len(frame.data) == 8:
            nodes.add(frame.arbitration_id >> 5)

    scan.listen(LISTEN_S, take)
    return [Found(n, {("node_id",): n}, f"ODrive axis, node {n}") for n in sorted(nodes)]


def damiaos(scan: CanScan) -> list[Found]:
    """Return the motors that say where they answer (MST_ID) and which ranges they have."""
    answers: dict[tuple[int, int], bytes] = {}

    def take(frame: can.Message) -> None:
        if not frame.is_extended_id and len(frame.data) == 8 and frame.data[2] == READ:
            whom = int.from_bytes(frame.data[:2], "little")
            answers[whom, frame.data[3]] = bytes(frame.data[4:])

    def read(motor: int, register: int) -> None:
        data = struct.pack("<HBB4x", motor, READ, register)
        scan.ask(_frame(DAMIAO_REGISTERS, data), take)

    for motor in range(1, 0x80):
        read(motor, MST_ID)
    for motor, _ in sorted(answers):
        for register in (PMAX, VMAX, TMAX):
            read(motor, register)
    return [_damiao(motor, answers) for motor, register in sorted(answers) if register == MST_ID]


def _damiao(motor: int, answers: dict[tuple[int, int], bytes]) -> Found:
    """Return a motor with the type that has its ranges, where they were answered."""
    host = int.from_bytes(answers[motor, MST_ID], "little")
    values: dict[tuple[str, ...], int | float | str] = {("motor_id",): motor, ("host_id",): host}
    tops = [
        struct.unpack("<f", answers[motor, register])[0]
        for register in (PMAX, VMAX, TMAX)
        if (motor, register) in answers
    ]
    words = f"Damiao, CAN_ID {motor}, MST_ID {host}"
    if len(tops) == 3:
        words += f", ranges {tops[0]:g} rad, {tops[1]:g} rad/s, {tops[2]:g} Nm"
    for name, ranges in DAMIAO_RANGES.items():
        if tops == [ranges.position, ranges.velocity, ranges.torque]:
            return Found(motor, values | {("motor",): name}, f"{words} ({name})")
    return Found(motor, values, words)


def typed_motors(scan: CanScan) -> list[Found]:
    """Return the CyberGears or RobStrides that answer type 0 with their unique number."""
    unique: dict[int, str] = {}

    def take(frame: can.Message) -> None:
        kind, motor, host = (
            frame.arbitration_id >> 24, frame.arbitration_id >> 8 & 0xFFFF,
            frame.arbitration_id & 0xFF,
        )  # fmt: skip
        if frame.is_extended_id and kind == 0 and host == 0xFE and len(frame.data) == 8:
            unique[motor] = bytes(frame.data).hex()

    for motor in range(1, 0x80):
        scan.ask(_frame(OWN_ID << 8 | motor, bytes(8), extended=True), take)
    return [
        Found(motor, {("motor_id",): motor}, f"motor {motor}, unique number {unique[motor]}")
        for motor in sorted(unique)
    ]


def moteus(scan: CanScan) -> list[Found]:
    """Return the controllers that say their model and firmware (registers 100h and 101h)."""
    said: dict[int, tuple[int, int]] = {}
    question = bytes((READ_INT32 | 2,)) + b"\x80\x02"  # 100h as a varuint
    answer = bytes((REPLY_INT32 | 2,)) + b"\x80\x02"
    counted = bytes((REPLY_INT32, 2)) + b"\x80\x02"

    def take(frame: can.Message) -> None:
        for head in (answer, counted):
            if frame.data[: len(head)] == head and len(frame.data) >= len(head) + 8:
                said[frame.arbitration_id >> 8 & 0x7F] = struct.unpack_from(
                    "<ii", frame.data, len(head)
                )

    for servo in range(1, 0x7F):
        body = question.ljust(8, b"\x50")
        scan.ask(_frame(MOTEUS_WANTED | servo, body, extended=True, fd=True), take)
    return [
        Found(
            servo,
            {("servo_id",): servo},
            f"moteus {servo}, model {model}, firmware "
            f"{firmware >> 16 & 0xFF}.{firmware >> 8 & 0xFF}.{firmware & 0xFF}",
        )
        for servo, (model, firmware) in sorted(said.items())
    ]


def vescs(scan: CanScan) -> list[Found]:
    """Return the controllers that answer a ping (17) with a pong (18)."""
    ids: set[int] = set()

    def take(frame: can.Message) -> None:
        if frame.is_extended_id and frame.arbitration_id == PONG << 8 | OWN_ID and frame.data:
            ids.add(frame.data[0])

    for controller in range(0xFF):
        if controller != OWN_ID:
            scan.ask(_frame(PING << 8 | controller, bytes((OWN_ID,)), extended=True), take)
    return [Found(i, {("controller_id",): i}, f"VESC {i}") for i in sorted(ids)]


def _frame(can_id: int, data: bytes, *, extended: bool = False, fd: bool = False) -> can.Message:
    return can.Message(
        arbitration_id=can_id, is_extended_id=extended, is_fd=fd, bitrate_switch=fd, data=data
    )


SCANS = {
    "odrive": odrives, "damiao": damiaos, "cybergear": typed_motors, "robstride": typed_motors,
    "moteus": moteus,
    "vesc": vescs,
}  # fmt: skip
