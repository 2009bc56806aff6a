"""Simulated devices that send frames: their rates and their bytes.

The bytes are made here by hand, from the data sheets; nothing is shared with the drivers that
read them.
"""

from __future__ import annotations

import binascii
import struct
from typing import TYPE_CHECKING, Protocol

from teleop_rt_drivers.simulated.line_frames import INT16, INT24
from teleop_rt_drivers.simulated.servo import FOLLOW, PlainServo

if TYPE_CHECKING:
    from collections.abc import Callable

    from teleop_rt_drivers.simulated.byte_faults import FaultyFrames
    from teleop_rt_drivers.simulated.line_frames import WrittenFrame
    from teleop_rt_drivers.simulated.plant import Plant

BOOT_NS = 30_000_000
"""Silence of a sensor after a reset."""
STANDARD_GRAVITY = 9.80665  # m/s2, by definition


class FrameDevice(Protocol):
    """A device on a serial line or a CAN bus of its own frames."""

    name: str
    faults: FaultyFrames

    def power_on(self) -> None:
        """Start."""

    def receive(self, data: bytes, now_ns: int) -> None:
        """Take the daemon's frames."""

    def run(self, now_ns: int) -> bool:
        """Do due work; return whether a measurement was sent."""

    def due_ns(self, now_ns: int) -> int:
        """Return when there is something to do next."""

    def reset(self) -> None:
        """Restart, as after a power failure."""


class Sensor:
    """Sends a measurement at a fixed rate, on a grid of its own: at `next_ns` the next one.

    A kernel may send it instead, by the frame `written`.
    """

    def __init__(
        self,
        name: str,
        encode: Callable[[int], bytes],
        period_ns: int,
        faults: FaultyFrames,
        banner: bytes = b"",
        written: WrittenFrame | None = None,
    ) -> None:
        self.name = name
        self.faults = faults
        self.written = written
        self.period_ns = period_ns
        self.next_ns = 0
        self._encode = encode
        self._banner = banner

    def power_on(self) -> None:
        """Send a device's first frames."""
        if self._banner:
            self.faults.send(self._banner)

    def receive(self, data: bytes, now_ns: int) -> None:
        """Ignore it: the device only sends."""

    def run(self, now_ns: int) -> bool:
        """Send the measurement that is due."""
        if now_ns < self.next_ns:
            return False
        late = now_ns - self.next_ns > self.period_ns
        self.next_ns = (now_ns if late else self.next_ns) + self.period_ns
        self.faults.send(self._encode(now_ns))
        return True

    def due_ns(self, now_ns: int) -> int:  # noqa: ARG002 - the drive's depends on it
        """Return when the next measurement is sent."""
        return self.next_ns

    def reset(self) -> None:
        """Start again: silent for a while, then as after power-on."""
        self.next_ns += BOOT_NS
        self.power_on()


class FramedServo:
    """A drive that answers each command it can read; a kernel may, by the frame `written`."""

    name = "drive"

    def __init__(
        self,
        servo: PlainServo,
        decode: Callable[[bytes], list[tuple[int, int]]],
        encode: Callable[[PlainServo], bytes],
        faults: FaultyFrames,
        written: WrittenFrame | None = None,
    ) -> None:
        self.servo = servo
        self.faults = faults
        self.written = written
        self.refuses = False
        self._decode = decode
        self._encode = encode

    @property
    def enabled(self) -> bool:
        """Return whether the drive follows commands."""
        return self.servo.enabled

    @property
    def powered(self) -> bool:
        """Return whether the motor has voltage."""
        return self.servo.powered

    def power_on(self) -> None:
        """Start without voltage."""
        self.servo.restart()

    def receive(self, data: bytes, now_ns: int) -> None:
        """Obey the commands that arrived, and answer each."""
        for control, target in self._decode(data):
            if not (self.refuses and control == FOLLOW and not self.enabled):
                self.servo.obey(control, target, now_ns)
            self.faults.send(self._encode(self.servo))

    def run(self, now_ns: int) -> bool:
        """Watch over the commands."""
        self.servo.run(now_ns)
        return False

    def due_ns(self, now_ns: int) -> int:
        """Return a time soon enough for the watchdog."""
        return now_ns + 5_000_000

    def reset(self) -> None:
        """Restart without voltage."""
        self.servo.restart()

    def overheat(self) -> None:
        """Fail for being too hot, of which it only says that it failed."""
        self.servo.fail()


def _after_a_byte(step: Callable[[int], int]) -> list[int]:
    """Return the remainder of each byte, whose eight bits take a step each."""
    table = list(range(256))
    for _ in range(8):
        table = [step(crc) for crc in table]
    return table


_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))
"""Each byte with its bits in the other order."""
_CRC8 = _after_a_byte(lambda crc: (crc << 1 ^ (0x07 if crc & 0x80 else 0)) & 0xFF)


def crc16_x25(data: bytes) -> int:
    """Return the CRC of X.25 (polynomial 0x1021, reflected).

    It is the library's CRC, which is not reflected, of the bytes with their bits turned round.
    """
    turned = binascii.crc_hqx(data.translate(_REVERSED), 0xFFFF) ^ 0xFFFF
    return _REVERSED[turned & 0xFF] << 8 | _REVERSED[turned >> 8]


def crc8(data: bytes) -> int:
    """Return the CRC with polynomial 0x07."""
    crc = 0
    for byte in data:
        crc = _CRC8[crc ^ byte]
    return crc


def clamped(value: float, limit: int) -> int:
    """Return the nearest whole number within the range of a field."""
    return max(-limit, min(limit, round(value)))


def counts(plant: Plant) -> Callable[[int], bytes]:
    """Return the encoder of the sensor that sends hundredths of a newton between 0x55 and 0xAA."""

    def encode(_: int) -> bytes:
        body = struct.pack(">hh", clamped(100.0 * plant.measured_force(), INT16), 0)
        return b"\x55" + body + bytes((sum(body) & 0xFF, 0xAA))

    return encode


def converter(plant: Plant) -> Callable[[int], bytes]:
    """Return the encoder of the bridge amplifier with 24 bits."""
    sequence = 0

    def encode(_: int) -> bytes:
        nonlocal sequence
        sequence = (sequence + 1) & 0xFF
        steps = clamped(plant.measured_force() / 2e-4, INT24)
        body = struct.pack(">B", sequence) + struct.pack(">i", steps)[1:] + b"\0"
        return b"\xa5\x5a" + body + bytes((crc8(body),))

    return encode


def load_cell(plant: Plant) -> Callable[[int], bytes]:
    """Return the encoder of the indicator that sends a mass in kilograms as text."""
    return lambda _: f"{plant.measured_force() / STANDARD_GRAVITY:+.4f} kg\r\n".encode()


def drive_commands(data: bytes, sync: int = 0xC3) -> list[tuple[int, int]]:
    """Return control and target of each whole command that arrived on the serial line."""
    found = []
    for at in range(len(data) - 8):
        frame = data[at : at + 9]
        if frame[0] == sync and struct.unpack("<H", frame[7:])[0] == crc16_x25(frame[1:7]):
            found.append(struct.unpack("<Bi", frame[2:7]))
    return found
