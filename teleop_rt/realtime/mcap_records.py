"""Walk through the records of an MCAP file, quickly: an hour of a trial is ten million messages.

The library reads a message field by field, forty microseconds each; here messages are only found,
a whole chunk at once by its index, and cut out where somebody wants them. All other records are
left to the library.
"""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from io import BytesIO
from typing import IO, TYPE_CHECKING

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from teleop_rt.realtime.mcap_chunk import (
    CHUNK,
    INDEX,
    KINDS,
    Unreadable,
    pairs_of,
    record_follows,
)
from teleop_rt.realtime.mcap_end import RECORD_HEAD, data_checksum_holds
from teleop_rt.realtime.mcap_resumed import Walk, next_chunk
from teleop_rt.realtime.mcap_unpack import CUT_OFF, packed_end, unpack_chunk

if TYPE_CHECKING:
    from teleop_rt.realtime.chunk_kernel import MessageFinder

Other = Schema | Channel | Metadata | Unreadable
Record = Other | Message
Place = NDArray[np.int64]
"""Where messages lie in their chunk (n, 3): begin of the text, end, sequence."""
Places = dict[int, Place]
"""The same by channel."""
_MESSAGE = struct.Struct("<HIQQ")
_HEADS = struct.Struct("<BQHI")
"""The head of every record, and for a message also its channel and sequence."""
_HEADS_TYPE = np.dtype(
    [("opcode", "u1"), ("length", "<u8"), ("channel", "<u2"), ("sequence", "<u4")]
)
"""`_HEADS` for many records at once."""
_BYTES_FOR_KERNEL = 64 << 20
"""Bytes of a file beyond which a kernel pays that finds messages in a tenth of the time, but loads
for 0.5 s."""
_BEFORE_TEXT = RECORD_HEAD.size + _MESSAGE.size
_A_MESSAGE = int(Opcode.MESSAGE)
_PLAIN: dict[int, Callable[[ReadDataStream], Other]] = {
    Opcode.SCHEMA: Schema.read,
    Opcode.CHANNEL: Channel.read,
    Opcode.METADATA: Metadata.read,
}
_NO_KIND = 0
"""Opcode that the format leaves invalid: zeros in place of a record."""
_FIRST_PRIVATE = 0x80
"""Opcodes from here on are anybody's own."""


@dataclass(slots=True)
class Messages:
    """Messages that follow one another, not yet cut out of `data`: the places by channel."""

    data: bytes
    places: Places

    def cut_out(self) -> Iterator[Message]:
        """Give each message whole, in the order of the file."""
        of_all = [(*p, channel) for channel, some in self.places.items() for p in some.tolist()]
        for begin, end, sequence, channel in sorted(of_all):
            *_, log_time, publish_time = _MESSAGE.unpack_from(self.data, begin - _MESSAGE.size)
            yield Message(channel, log_time, self.data[begin:end], publish_time, sequence)


def blocks(stream: IO[bytes], from_ns: float = 0.0) -> Iterator[Other | Messages]:
    """Give schemas, channels, messages and metadata in the order of the file, up to its index.

    Chunks whose messages are all stamped before `from_ns` are left out, with the channels that
    they declare. A chunk with damaged content that another record follows is given as such, and
    so are the records before the next whole chunk where a head or a length is damaged. Where
    the checksum of all data holds, those of the chunks are not computed: a fifth of the work.
    Raises EOFError where the file was cut off, and the library's errors for any other broken
    record that no whole chunk follows, or where the checksum of the file is wrong and no chunk is.
    """
    size = os.fstat(stream.fileno()).st_size
    walk = Walk(data_checksum_holds(stream))
    stream.seek(len(MCAP0_MAGIC))
    decompressor = zstandard.ZstdDecompressor()
    finder = _finder(size)
    while True:
        try:
            yield from _undamaged(stream, size, from_ns, walk, decompressor, finder)
        except CUT_OFF:
            place = stream.tell()
            found = next_chunk(stream, walk.sure, size, decompressor)
            if found is None:
                stream.seek(place)
                raise
            yield from walk.lost_before(stream, found)
            stream.seek(found)
        else:
            return


def _undamaged(
    stream: IO[bytes],
    size: int,
    from_ns: float,
    walk: Walk,
    decompressor: zstandard.ZstdDecompressor,
    finder: MessageFinder | None,
) -> Iterator[Other | Messages]:
    """Give the records up to the index of the file, or raise where one is damaged; see `blocks`."""
    while True:
        head = stream.read(RECORD_HEAD.size)
        if len(head) < RECORD_HEAD.size:
            raise EOFError
        opcode, length = RECORD_HEAD.unpack(head)
        begin = stream.tell()
        if opcode == _NO_KIND or begin + length > size:
            raise EOFError
        content = stream.read(length)
        if opcode == Opcode.DATA_END:
            if walk.sound is False and not walk.damaged:
                raise McapError("the checksum of the file is wrong")
            return
        if opcode == Opcode.CHUNK:
            walk.sure = begin
            if CHUNK.unpack_from(content)[1] < from_ns:
                walk.sure += length if packed_end(content) == length else 0
                continue
            indices = _read_indices(stream, size)
            try:
                unpacked = unpack_chunk(content, decompressor, verify=not walk.sound)
            except CUT_OFF:
                if not record_follows(stream, size):
                    raise
                yield walk.lost(content, indices)
                continue
            walk.sure = begin + packed_end(content)
            walk.take(content, indices)
            yield from _found(unpacked, indices, finder)
        elif opcode in _PLAIN or opcode == Opcode.MESSAGE:
            yield from _walk(head + content)
        elif walk.sound is False and opcode < _FIRST_PRIVATE and opcode not in KINDS:
            raise McapError(f"no record has the opcode {opcode}")


def _read_indices(stream: IO[bytes], size: int) -> list[bytes]:
    """Return the whole message indices that follow a chunk."""
    indices: list[bytes] = []
    while True:
        at = stream.tell()
        head = stream.read(RECORD_HEAD.size)
        opcode, length = RECORD_HEAD.unpack(head) if len(head) == RECORD_HEAD.size else (0, 0)
        if opcode != Opcode.MESSAGE_INDEX or at + RECORD_HEAD.size + length > size:
            stream.seek(at)
            return indices
        indices.append(stream.read(length))


def _finder(size: int) -> MessageFinder | None:
    """Return the finder of messages of a file of so many bytes; None where its indices serve."""
    if size <= _BYTES_FOR_KERNEL:
        return None
    from teleop_rt.realtime.chunk_kernel import MessageFinder  # noqa: PLC0415 - needs the compiler

    return MessageFinder()


def _found(
    data: bytes, indices: list[bytes], finder: MessageFinder | None
) -> Iterator[Other | Messages]:
    """Give the records of a chunk: messages alone at once, else one by one.

    Its indices say where messages lie if these are complete, or a finder does.
    """
    places = indexed(data, indices) if finder is None else finder.places(data)
    if places is None:
        yield from _walk(data)
    elif places:
        yield Messages(data, places)


def indexed(data: bytes, indices: list[bytes]) -> Places | None:
    """Return where a chunk's messages lie; None if the indices do not cover every byte of it.

    An index is accepted only if a message of its channel begins at each place, and the next one at
    its end.
    """
    offsets: list[NDArray[np.uint64]] = []
    channels: dict[int, slice] = {}
    count = 0
    for content in indices:
        pairs = pairs_of(content)
        if pairs is None or (channel := INDEX.unpack_from(content)[0]) in channels:
            return None
        if len(pairs):
            channels[channel] = slice(count, count + len(pairs))
            offsets.append(pairs[:, 1])
            count += len(pairs)
    places = _places(data, np.concatenate(offsets), channels) if offsets else None
    if places is None:
        return None
    first = sorted(channels, key=lambda channel: int(places[channels[channel].start, 0]))
    return {channel: places[channels[channel]] for channel in first}


def _places(data: bytes, offsets: NDArray[np.uint64], channels: dict[int, slice]) -> Place | None:
    """Return where messages lie that begin at offsets (n,), those of a channel in each slice.

    None where these are not all of the messages of `data`, each once, in order by channel.
    """
    if int(offsets.max()) + _BEFORE_TEXT > len(data):
        return None
    begins = offsets.astype(np.int64)
    anywhere = (len(data) - _HEADS_TYPE.itemsize + 1,)
    heads = np.ndarray(anywhere, _HEADS_TYPE, data, strides=(1,))[begins]
    if not (heads["opcode"] == _A_MESSAGE).all() or int(heads["length"].max()) > len(data):
        return None
    ends = begins + RECORD_HEAD.size + heads["length"].astype(np.int64)
    order = np.argsort(begins)
    following = np.append(begins[order[1:]], len(data))
    if begins[order[0]] or (ends[order] != following).any():
        return None
    sizes = [some.stop - some.start for some in channels.values()]
    backwards = np.flatnonzero(np.diff(begins) <= 0) + 1
    if not {some.start for some in channels.values()}.issuperset(backwards.tolist()):
        return None
    places = np.empty((begins.size, 3), dtype=np.int64)
    places[:, 0], places[:, 1], places[:, 2] = begins + _BEFORE_TEXT, ends, heads["sequence"]
    if (heads["channel"] != np.repeat(list(channels), sizes)).any() or (
        places[:, 1] < places[:, 0]
    ).any():
        return None
    return places


def _walk(data: bytes) -> Iterator[Other | Messages]:
    """Give the records of `data`, messages that follow one another at once."""
    at, size = 0, len(data)
    places: defaultdict[int, list[tuple[int, int, int]]] = defaultdict(list)
    text_of_head = _HEADS.size
    while at + text_of_head <= size:
        opcode, length, channel, sequence = _HEADS.unpack_from(data, at)
        end = at + RECORD_HEAD.size + length
        if end > size:
            break
        if opcode == _A_MESSAGE:
            places[channel].append((at + _BEFORE_TEXT, end, sequence))
        elif opcode in _PLAIN:
            if places:
                yield Messages(data, _arrays(places))
                places = defaultdict(list)
            yield _PLAIN[opcode](ReadDataStream(BytesIO(data[at + RECORD_HEAD.size : end])))
        at = end
    if places:
        yield Messages(data, _arrays(places))
    if at < size:
        raise EOFError


def _arrays(places: dict[int, list[tuple[int, int, int]]]) -> Places:
    return {channel: np.array(some, dtype=np.int64) for channel, some in places.items()}
