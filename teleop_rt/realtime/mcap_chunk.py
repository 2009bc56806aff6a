"""A chunk of an MCAP file: its head, its indices, and damage to it that left the others whole."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import IO

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from teleop_rt.realtime.mcap_end import RECORD_HEAD

CHUNK = struct.Struct("<QQQII")
"""The head of a chunk: the stamps [ns] of its first message and of its last, the bytes of its
records and their checksum, and the letters of how they are packed, which follow."""
INDEX = struct.Struct("<HI")
"""Channel and bytes of an index, before its pairs of time and offset."""
_PAIR_BYTES = 16
"""A message's time and offset in an index."""
KINDS = frozenset(int(kind) for kind in Opcode)
"""Opcodes of the records that the format knows."""


@dataclass(frozen=True, slots=True)
class Unreadable:
    """A chunk, or records up to the next one, that are damaged; times are the writer's."""

    messages: int
    """How many its indices count; 0 where there is no index."""
    first_ns: int
    last_ns: int
    after_s: float
    """From the first message of the file to `first_ns`."""

    @property
    def until_s(self) -> float:
        """Return the time from the first message of the file to the last one of the chunk."""
        return self.after_s + 1e-9 * (self.last_ns - self.first_ns)


def counted(content: bytes, indices: Sequence[bytes]) -> tuple[int, int, int]:
    """Return the number of messages of a chunk and its first and last stamp [ns], by its indices.

    Without any, the number is 0 and the stamps are those of the head, which may be damaged itself.
    """
    found = [pairs for one in indices if (pairs := pairs_of(one)) is not None and len(pairs)]
    if not found:
        return 0, *CHUNK.unpack_from(content)[:2]
    stamps = np.concatenate([pairs[:, 0] for pairs in found])
    return stamps.size, int(stamps.min()), int(stamps.max())


def record_follows(stream: IO[bytes], size: int) -> bool:
    """Return whether a record of a known kind begins here and ends within the file."""
    at = stream.tell()
    head = stream.read(RECORD_HEAD.size)
    stream.seek(at)
    if len(head) < RECORD_HEAD.size:
        return False
    opcode, length = RECORD_HEAD.unpack(head)
    return opcode in KINDS and at + RECORD_HEAD.size + length <= size


def pairs_of(index: bytes) -> NDArray[np.uint64] | None:
    """Return time and offset of each message (n, 2) in an index; None where it is none."""
    if len(index) < INDEX.size:
        return None
    length = INDEX.unpack_from(index)[1]
    if length % _PAIR_BYTES or length + INDEX.size != len(index):
        return None
    return np.frombuffer(index, dtype="<u8", offset=INDEX.size).reshape(-1, 2)
