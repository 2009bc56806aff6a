"""Checksums of serial and CAN frames, by the names that data sheets use.

The 16-bit ones of CRC-CCITT's family run in C: `binascii.crc_hqx` computes the unreflected form,
and the reflected one (X-25) is the same on bit-reversed bytes.
"""

from __future__ import annotations

import binascii
import zlib
from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Literal, get_args

ChecksumKind = Literal[
    "sum8", "xor8", "crc8", "crc8-j1850", "crc16-x25", "crc16-ccitt", "crc16-modbus", "crc32"
]
KINDS: tuple[ChecksumKind, ...] = get_args(ChecksumKind)

_REVERSED = bytes(int(f"{byte:08b}"[::-1], 2) for byte in range(256))


def _crc8_table(polynomial: int) -> bytes:
    """Return the remainders of all bytes, most significant bit first."""
    table = bytearray()
    for byte in range(256):
        for _ in range(8):
            byte = byte << 1 ^ (polynomial if byte & 0x80 else 0)  # noqa: PLW2901 - it is shifted
        table.append(byte & 0xFF)
    return bytes(table)


def _modbus_table() -> tuple[int, ...]:
    """Return the remainders of all bytes, least significant bit first."""
    table = []
    for word in range(256):
        for _ in range(8):
            word = word >> 1 ^ (0xA001 if word & 1 else 0)  # noqa: PLW2901 - it is shifted
        table.append(word)
    return tuple(table)


_CRC8 = _crc8_table(0x07)
_CRC8_J1850 = _crc8_table(0x1D)
_MODBUS = _modbus_table()


def _crc8(data: bytes) -> int:
    value = 0
    for byte in data:
        value = _CRC8[value ^ byte]
    return value


def _crc8_j1850(data: bytes) -> int:
    value = 0xFF
    for byte in data:
        value = _CRC8_J1850[value ^ byte]
    return value ^ 0xFF


def _crc16_x25(data: bytes) -> int:
    value = binascii.crc_hqx(data.translate(_REVERSED), 0xFFFF)
    return (_REVERSED[value & 0xFF] << 8 | _REVERSED[value >> 8]) ^ 0xFFFF


def _crc16_ccitt(data: bytes) -> int:
    return binascii.crc_hqx(data, 0xFFFF)


def _crc16_modbus(data: bytes) -> int:
    value = 0xFFFF
    for byte in data:
        value = value >> 8 ^ _MODBUS[(value ^ byte) & 0xFF]
    return value


_FUNCTIONS: dict[ChecksumKind, tuple[Callable[[bytes], int], int]] = {
    "sum8": (lambda data: sum(data) & 0xFF, 1),
    "xor8": (lambda data: reduce(xor, data, 0), 1),
    "crc8": (_crc8, 1),
    "crc8-j1850": (_crc8_j1850, 1),
    "crc16-x25": (_crc16_x25, 2),
    "crc16-ccitt": (_crc16_ccitt, 2),
    "crc16-modbus": (_crc16_modbus, 2),
    "crc32": (zlib.crc32, 4),
}


def checksum(kind: ChecksumKind) -> tuple[Callable[[bytes], int], int]:
    """Return the function of a kind of checksum, and its size in bytes."""
    return _FUNCTIONS[kind]
