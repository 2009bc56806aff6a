"""The checksums of `checksum` as kernels: sums, and remainders of a division by a polynomial."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.jit import kernel
from teleop_rt.kernels.record import record_type

if TYPE_CHECKING:
    from teleop_rt_drivers.framed.checksum import ChecksumKind

Bytes = NDArray[np.uint8]
Table = NDArray[np.uint32]

NONE, _SUM, _XOR, _FORWARD, _BACKWARD = range(5)
"""Ways to a checksum; a remainder takes the most or the least significant bit of a byte first."""


class Check:
    """Fields of a checksum: the way to it, its bits, first remainder and final inversion."""

    way: int
    bits: int
    start: int
    inverted: int


_CHECK = record_type(Check)
StoredCheck = NDArray[np.record]
_REMAINDERS: dict[str, tuple[int, int, int, int, int]] = {
    "crc8": (_FORWARD, 8, 0x07, 0, 0),
    "crc8-j1850": (_FORWARD, 8, 0x1D, 0xFF, 0xFF),
    "crc16-x25": (_BACKWARD, 16, 0x8408, 0xFFFF, 0xFFFF),
    "crc16-ccitt": (_FORWARD, 16, 0x1021, 0xFFFF, 0),
    "crc16-modbus": (_BACKWARD, 16, 0xA001, 0xFFFF, 0),
    "crc32": (_BACKWARD, 32, 0xEDB88320, 0xFFFFFFFF, 0xFFFFFFFF),
}
"""Way, bits, polynomial (reversed where it goes backward), first remainder, final inversion."""


def new_check(kind: ChecksumKind | None) -> tuple[StoredCheck, Table]:
    """Return a kind of checksum for kernels, and the remainders of all bytes (256,)."""
    stored, table = np.zeros(1, _CHECK), np.zeros(256, np.uint32)
    check = cast("Check", stored[0])
    if kind in _REMAINDERS:
        check.way, check.bits, polynomial, check.start, check.inverted = _REMAINDERS[kind]
        for byte in range(256):
            table[byte] = _remainder(byte, check.way, check.bits, polynomial)
    elif kind is not None:
        check.way, check.bits = {"sum8": _SUM, "xor8": _XOR}[kind], 8
    return stored, table


def _remainder(byte: int, way: int, bits: int, polynomial: int) -> int:
    """Return the remainder of one byte, bit by bit."""
    word = byte if way == _BACKWARD else byte << bits - 8
    for _ in range(8):
        if way == _BACKWARD:
            word = word >> 1 ^ (polynomial if word & 1 else 0)
        else:
            word = word << 1 ^ (polynomial if word >> bits - 1 else 0)
            word &= (1 << bits) - 1
    return word


@kernel
def check_of(stored: StoredCheck, table: Table, data: Bytes | bytes, first: int, end: int) -> int:
    """Return the checksum of the bytes from `first` to before `end`."""
    check: Any = stored[0]
    way, bits = check.way, np.int64(check.bits)
    word, all_bits = np.int64(check.start), (np.int64(1) << bits) - np.int64(1)
    for at in range(first, end):
        byte = np.int64(data[at])
        if way == _SUM:
            word = word + byte & all_bits
        elif way == _XOR:
            word ^= byte
        elif way == _FORWARD:
            index = word >> (bits - np.int64(8)) ^ byte
            word = (word << np.int64(8) ^ np.int64(table[index])) & all_bits
        else:
            word = word >> np.int64(8) ^ np.int64(table[(word ^ byte) & 0xFF])
    return int(word ^ check.inverted)
