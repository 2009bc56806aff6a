"""Bus servos on a half-duplex line, pinged at each of their baud rates."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

from teleop_rt_drivers.actuators import dynamixel, feetech
from teleop_rt_drivers.scanning.found import Found

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from teleop_rt_drivers.framed.stream import ByteStream

    OpenLine = Callable[[int], ByteStream]

PING = 0x01  # instruction of Dynamixel's and of Feetech's protocol
# In the order in which they are tried: the presets' own first.
DYNAMIXEL_BAUDS = (3_000_000, 1_000_000, 57_600, 2_000_000, 4_000_000, 115_200)
FEETECH_BAUDS = (1_000_000, 500_000, 115_200)
ALL_ANSWER_S = 0.4
"""Until the last of 253 has answered a ping to all: 3 ms each at worst, most need less."""
ONE_ANSWERS_S = 0.005
"""Wait for one servo's answer to a ping."""
FEETECH_IDS = range(254)


def dynamixels(open_line: OpenLine, bauds: Iterable[int] = DYNAMIXEL_BAUDS) -> list[Found]:
    """Return the drives that answer a ping to all, at the first baud rate where any does."""
    question = dynamixel.packet(dynamixel.BROADCAST, PING, b"")
    for baud in bauds:
        line = open_line(baud)
        try:
            heard = _asked(line, question, ALL_ANSWER_S)
        finally:
            line.close()
        if found := _dynamixel_pongs(heard, baud):
            return found
    return []


def _dynamixel_pongs(heard: bytes, baud: int) -> list[Found]:
    """Return the drives whose status packets, each with a right CRC, are among the bytes heard."""
    found, at = [], 0
    while (at := heard.find(dynamixel.HEADER, at)) >= 0:
        packet = heard[at : at + 14]
        at += 1
        sound = len(packet) == 14 and dynamixel.crc16(packet[:-2]) == int.from_bytes(
            packet[-2:], "little"
        )
        if not sound or packet[7] != dynamixel.STATUS:
            continue
        servo, model, firmware = packet[4], int.from_bytes(packet[9:11], "little"), packet[11]
        words = f"Dynamixel {servo} at {baud} baud, model {model}, firmware {firmware}"
        found.append(Found(servo, {("servo_id",): servo, ("baud",): baud}, words))
    return found


def feetechs(open_line: OpenLine, bauds: Iterable[int] = FEETECH_BAUDS) -> list[Found]:
    """Return the servos that answer a ping of their own, at the first baud rate where any does."""
    for baud in bauds:
        line = open_line(baud)
        try:
            ids = [servo for servo in FEETECH_IDS if _feetech_answers(line, servo)]
        finally:
            line.close()
        if ids:
            return [
                Found(servo, {("servo_id",): servo, ("baud",): baud},
                      f"Feetech {servo} at {baud} baud")
                for servo in ids
            ]  # fmt: skip
    return []


def _feetech_answers(line: ByteStream, servo: int) -> bool:
    """Return whether a status of six bytes comes back; an adapter's echo of ours is none."""
    question = feetech.packet(servo, PING, b"")
    heard = _asked(line, question, ONE_ANSWERS_S).replace(question, b"", 1)
    at = heard.find(feetech.HEADER + bytes((servo, 2)))
    return (
        at >= 0
        and len(heard) >= at + 6
        and feetech.checksum(heard[at + 2 : at + 5]) == heard[at + 5]
    )


def _asked(line: ByteStream, question: bytes, seconds: float) -> bytes:
    """Return the bytes within this time after a question, up to a pause of a third of it."""
    line.read()
    line.write(question)
    heard, end_s = b"", time.monotonic() + seconds
    while (left_s := end_s - time.monotonic()) > 0:
        line.wait(min(left_s, seconds / 3))
        data = line.read()
        if not data:
            break
        heard += data
    return heard


SCANS = {"dynamixel": dynamixels, "feetech": feetechs}
