"""Frames of simulated devices on serial lines as kernels: made by hand, from the data sheets.

Nothing is shared with the drivers that read them.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import bound, kernel, shared
from teleop_rt_drivers.simulated.senses import clamped

DEVICE_CLOCK_PPM = 40
"""Drift of a device's own clock against ours [ppm]."""
INT16, INT24, INT32 = 2**15 - 1, 2**23 - 1, 2**31 - 1
WRENCH, EDGES, DRIVE = range(3)
"""Kinds of frames: of the six-axis force sensor, whose tool presses along z, of the counter board,
and of a drive's answer.
"""
LONGEST = 37
"""Bytes of the longest frame."""
COMMAND_BYTES = 9
"""Of a command to a drive: first byte, count, control, target, checksum."""
_FIRST = {
    WRENCH: b"\xaa" + struct.pack("<H6fIf", 0, *[0.0] * 6, 0, 24.5) + bytes(2),
    EDGES: b"\x51" + bytes(11),
    DRIVE: b"\x3c" + bytes(8),
}
"""The bytes of each kind that no value changes, with room for the others."""
_POLYNOMIAL, _ALL_BITS = 0x8408, 0xFFFF  # of the CRC of X.25, reflected
_COUNT_AT, _SUM_BYTES, _WORD_BYTES = 1, 2, 4  # a frame's count, its checksum, and other fields

Bytes = NDArray[np.uint8]


@shared
def device_time_us(now_ns: int) -> int:
    """Return a device's own 32-bit microsecond counter."""
    return (now_ns + now_ns // 1_000_000 * DEVICE_CLOCK_PPM) // 1000 & 0xFFFFFFFF


@kernel
def crc16_of(data: Bytes, first: int, end: int) -> int:
    """Return the CRC of X.25 of the bytes from `first` to before `end`."""
    crc = np.int64(_ALL_BITS)
    for at in range(first, end):
        crc ^= np.int64(data[at])
        for _ in range(8):
            crc = crc >> 1 ^ (_POLYNOMIAL if crc & 1 else 0)
    return int(crc ^ _ALL_BITS)


@kernel
def number_of(data: Bytes, at: int, size: int) -> int:
    """Return the unsigned number of so many bytes, the lowest first."""
    number = np.int64(0)
    for byte in range(size):
        number |= np.int64(data[at + byte]) << np.int64(8 * byte)
    return int(number)


@kernel
def put(data: Bytes, at: int, size: int, number: int) -> None:
    """Write the lowest bytes of a number, the lowest first."""
    for byte in range(size):
        data[at + byte] = np.int64(number) >> np.int64(8 * byte) & 0xFF


@kernel
def write_frame(data: Bytes, kind: int, value: float, state: int, now_ns: int) -> None:
    """Write a value into the frame before: a force, edges or counts; a drive's has a state, too."""
    if kind == WRENCH:
        put(data, 11, _WORD_BYTES, int(np.float32(value).view(np.uint32)))
        put(data, 27, _WORD_BYTES, device_time_us(now_ns))
        end = 35
    else:
        data[_COUNT_AT] = (np.int64(data[_COUNT_AT]) + 1) & 0xFF
        if kind == EDGES:
            put(data, 2, _WORD_BYTES, clamped(value, INT32))
            put(data, 6, _WORD_BYTES, device_time_us(now_ns))
            end = 10
        else:
            data[2] = state
            put(data, 3, _WORD_BYTES, clamped(value, INT32))
            end = 7
    put(data, end, _SUM_BYTES, crc16_of(data, 1, end))


class WrittenFrame:
    """A device's frame of a kind, which a kernel writes into `data` for each value."""

    def __init__(self, kind: int, first: bytes = b"") -> None:
        self.kind = kind
        frame = first + _FIRST[kind][len(first) :]
        self.move_to(np.frombuffer(bytearray(frame), np.uint8))

    def move_to(self, data: Bytes) -> None:
        """Write into these bytes (length,) from now on, which hold the frame before."""
        self.data = data
        self._write = bound(write_frame, (data,), 0, 0.0, 0, 0)

    def of(self, value: float, state: int = 0, now_ns: int = 0) -> bytes:
        """Return the frame of a value."""
        self._write(self.kind, float(value), int(state), now_ns)
        return self.data.tobytes()
