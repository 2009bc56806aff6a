"""The next whole chunk behind damage to the framing of an MCAP file: a wrong length, or no head."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

from teleop_rt.realtime.mcap_chunk import CHUNK, INDEX, Unreadable, counted, pairs_of
from teleop_rt.realtime.mcap_end import RECORD_HEAD
from teleop_rt.realtime.mcap_unpack import COUNT, CUT_OFF, LONGEST_CHUNK, packed_end, unpack_chunk

_BLOCK = 1 << 20
"""Bytes read at once for the search."""
_MOST_TRIED = 64
"""Chunks that look whole and whose content does not hold, before the search ends; by chance no
bytes look like one."""
_LETTERS = frozenset((b"", b"lz4", b"zstd"))
"""How the records of a chunk may be packed."""
_HEAD_BYTES = CHUNK.size + max(map(len, _LETTERS)) + COUNT.size


@dataclass(slots=True)
class Walk:
    """How far the records of a file were read, and whether any are damaged."""

    sound: bool | None
    """Whether the checksum of all data holds; None where there is none."""
    sure: int = len(MCAP0_MAGIC)
    """Place behind the last chunk that was read, or within one that could not be."""
    begin_ns: int | None = None
    last: tuple[bytes, list[bytes]] | None = None
    """The last chunk that was read, or counted as lost, with its indices."""
    damaged: bool = False

    def take(self, content: bytes, indices: list[bytes]) -> None:
        """Count a chunk with its indices among those that were read."""
        if self.begin_ns is None:
            self.begin_ns = counted(content, indices)[1]
        self.last = content, indices

    def lost(self, content: bytes, indices: list[bytes]) -> Unreadable:
        """Return a chunk with its indices as unreadable."""
        self.damaged = True
        self.take(content, indices)
        messages, first_ns, last_ns = counted(content, indices)
        return Unreadable(messages, first_ns, last_ns, 1e-9 * (first_ns - (self.begin_ns or 0)))

    def lost_before(self, stream: IO[bytes], found: int) -> Iterator[Unreadable]:
        """Give the records between the last chunk and the one found, unless none is lost."""
        indices, alone = indices_between(stream, self.sure, found)
        self.damaged = True
        if alone:
            return
        after_ns = -1 if self.last is None else counted(*self.last)[2]
        stream.seek(found + RECORD_HEAD.size)
        until_ns, *rest = CHUNK.unpack(stream.read(CHUNK.size))
        span = CHUNK.pack(until_ns if after_ns < 0 else after_ns, until_ns, *rest[1:])
        of_lost = (one for one in indices if (pairs := pairs_of(one)) is not None and len(pairs))
        yield self.lost(span, [one for one in of_lost if counted(span, [one])[2] > after_ns])


def next_chunk(
    stream: IO[bytes], begin: int, size: int, decompressor: zstandard.ZstdDecompressor
) -> int | None:
    """Return where the first chunk from `begin` on lies whose checksum holds; None without one."""
    tried = 0
    for at in _heads(stream, Opcode.CHUNK, begin, size):
        content = _like_chunk(stream, at, size)
        if content is None:
            continue
        try:
            unpack_chunk(content, decompressor)
        except CUT_OFF:
            tried += 1
            if tried == _MOST_TRIED:
                return None
        else:
            return at
    return None


def _like_chunk(stream: IO[bytes], at: int, size: int) -> bytes | None:
    """Return the content of the record at `at` if its head is that of a chunk with a checksum."""
    stream.seek(at)
    _, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
    begin = stream.tell()
    head = stream.read(_HEAD_BYTES)
    if begin + length > size or not CHUNK.size + COUNT.size <= length or len(head) < _HEAD_BYTES:
        return None
    *_, unpacked, checksum, letters = CHUNK.unpack_from(head)
    if unpacked > LONGEST_CHUNK or checksum == 0 or letters > max(map(len, _LETTERS)):
        return None
    if head[CHUNK.size : CHUNK.size + letters] not in _LETTERS or packed_end(head) != length:
        return None
    stream.seek(begin)
    return stream.read(length)


def indices_between(stream: IO[bytes], begin: int, end: int) -> tuple[list[bytes], bool]:
    """Return the message indices between two places, and whether there is nothing else."""
    indices: list[bytes] = []
    behind, alone = begin, True
    for at in _heads(stream, Opcode.MESSAGE_INDEX, begin, end):
        stream.seek(at)
        _, length = RECORD_HEAD.unpack(stream.read(RECORD_HEAD.size))
        first = stream.read(INDEX.size)
        if at < behind or len(first) < INDEX.size or stream.tell() + length > end + INDEX.size:
            continue
        if INDEX.unpack(first)[1] + INDEX.size != length:
            continue
        content = first + stream.read(length - INDEX.size)
        if pairs_of(content) is not None:
            alone = alone and at == behind
            indices.append(content)
            behind = stream.tell()
    return indices, alone and behind == end


def _heads(stream: IO[bytes], kind: Opcode, begin: int, end: int) -> Iterator[int]:
    """Yield each place that may be the head of a record of a kind, with less than 4 GB."""
    pattern = re.compile(b"(?=" + re.escape(bytes([kind])) + rb"[\s\S]{4}\0{4})")
    while begin + RECORD_HEAD.size <= end:
        stream.seek(begin)
        block = stream.read(min(_BLOCK, end - begin))
        if len(block) < RECORD_HEAD.size:
            return
        for found in pattern.finditer(block):
            yield begin + found.start()
        begin += len(block) - RECORD_HEAD.size + 1
