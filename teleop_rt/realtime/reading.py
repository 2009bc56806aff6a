"""Read recordings: parts of a run in order, damage reported, memory bounded."""

from __future__ import annotations

import functools
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from mcap.records import Channel, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from teleop_rt.errors import RecordingError
from teleop_rt.realtime.columns import Rows, TopicColumns
from teleop_rt.realtime.mcap_chunk import Unreadable
from teleop_rt.realtime.mcap_end import ends_whole
from teleop_rt.realtime.mcap_index import count_messages, declared_channels
from teleop_rt.realtime.mcap_records import Messages, Other, Places, Record, blocks
from teleop_rt.realtime.mcap_unpack import CUT_OFF
from teleop_rt.realtime.parts import parts
from teleop_rt.realtime.recording import LARGEST_SEQUENCE
from teleop_rt.recordings.memory import most_bytes, refuse_more

_IDS_PER_PART = 1 << 16
"""Channels of one part of a recording, so that ids of parts do not meet."""
_MOST_NAMED = 5
"""Damaged parts whose times a message gives; the others are only counted."""
_LONGEST_CHUNK = 1 << 20
"""A crash cuts a file off within its last chunk, of 256 kB unpacked; more left is damage."""


def read_metadata(path: Path, name: str) -> dict[str, str] | None:
    """Return a named metadata record, None where there is none. Raises RecordingError."""
    for record in read_records(path):
        if isinstance(record, Metadata) and record.name == name:
            return dict(record.metadata)
    return None


def read_records(path: Path) -> Iterator[Record]:
    """Give every record that can be read, part after part, each up to where it was cut off.

    Ids of schemas and channels are distinguished by part. A row in two parts, because a recorder
    ended before it could confirm that it had written it, is given once.
    """
    for block in _read_blocks(path):
        if isinstance(block, Messages):
            yield from block.cut_out()
        else:
            yield block


def _read_blocks(path: Path, from_ns: float = 0.0) -> Iterator[Other | Messages]:
    """Yield the records of `read_records`, messages in whole blocks and not yet cut out.

    Chunks before `from_ns` may be left out: not where several parts may hold one row.
    """
    last: dict[str, int] = {}
    files = parts(path) or [path]
    for index, one in enumerate(files):
        topics: dict[int, str] = {}
        newest = dict(last)
        offset = index * _IDS_PER_PART
        for block in _blocks_of(one, from_ns if len(files) == 1 else 0.0):
            if isinstance(block, Messages):
                if index:
                    block.places = _new_places(block.places, offset, topics, last)
                for channel, places in block.places.items():
                    newest[topics.get(channel, "")] = int(places[-1, -1])
            else:
                _offset_ids(block, offset)
                if isinstance(block, Channel):
                    topics[block.id] = block.topic
            yield block
        last = newest


def _new_places(
    places: Places, offset: int, topics: Mapping[int, str], last: Mapping[str, int]
) -> Places:
    """Return the messages of a later part that no earlier one held, with distinct channels."""
    found = {}
    for channel, some in places.items():
        topic = topics.get(channel + offset, "")
        held = last.get(topic)
        new = some if held is None else some[~_known(some[:, -1], held)]
        if len(new):
            found[channel + offset] = new
    return found


def _known(numbers: NDArray[np.int64], last: int) -> NDArray[np.bool_]:
    """Return which rows' numbers (n,), of which MCAP holds 32 bits, come no later than the last.

    Rows that were not numbered all have 0.
    """
    numbered: NDArray[np.bool_] = (numbers != 0) | bool(last)
    return numbered & ((last - numbers) & LARGEST_SEQUENCE <= LARGEST_SEQUENCE // 2)


def _offset_ids(record: Other, offset: int) -> None:
    if isinstance(record, Schema | Channel):
        record.id += offset
    if isinstance(record, Channel) and record.schema_id:
        record.schema_id += offset


def _blocks_of(path: Path, from_ns: float) -> Iterator[Other | Messages]:
    lost: list[Unreadable] = []
    try:
        with path.open("rb") as stream:
            if not MCAP0_MAGIC.startswith(stream.read(len(MCAP0_MAGIC))):
                raise RecordingError(
                    f"{path}: not an MCAP recording: give one that teleop-rt has written"
                )
            try:
                declared = declared_channels(path) if from_ns else []
                yield from declared
                for block in blocks(stream, from_ns if declared else 0.0):
                    yield block
                    if isinstance(block, Unreadable):
                        if not lost:  # it may be the one that declares them
                            yield from declared_channels(path)
                        lost.append(block)
            except CUT_OFF as error:
                place, size = stream.tell(), path.stat().st_size
                cut_off = isinstance(error, EOFError) and size - place <= _LONGEST_CHUNK
                if not cut_off or ends_whole(stream):
                    _say_damaged(path, place, size)
            if lost:
                _say_unreadable(path, in_words(lost))
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be read: {error.strerror}: check the path and who may read it"
        ) from None


@functools.cache
def _say_damaged(path: Path, place: int, size: int) -> None:
    """Say once that a recording is damaged, and where that was noticed."""
    print(
        f"{path}: damaged before byte {place} of {size}: rows are missing or wrong; use a copy, or"
        " the file that `recover` makes of it",
        file=sys.stderr,
    )


@functools.cache
def _say_unreadable(path: Path, lost: str) -> None:
    """Say once how much in the middle of a recording cannot be read."""
    print(f"{path}: damaged: {lost}; use a copy if there is one", file=sys.stderr)


def in_words(lost: Sequence[Unreadable]) -> str:
    """Return how much cannot be read, at least one chunk, and of which times, as a sentence."""
    count = sum(one.messages for one in lost)
    least = "" if all(one.messages for one in lost) else "at least "
    messages = f"{least}{count} messages" if count else "an unknown number of messages"
    parts_lost = "1 part" if len(lost) == 1 else f"{len(lost)} parts"
    spans = ", ".join(f"{one.after_s:.3f} s to {one.until_s:.3f} s" for one in lost[:_MOST_NAMED])
    more = ", ..." if len(lost) > _MOST_NAMED else ""
    return (
        f"{parts_lost} of the file with {messages}, of {spans}{more} after its beginning,"
        " cannot be read; all others are read"
    )


def read_messages(
    path: Path, topics: Iterable[str], from_ns: float = 0.0
) -> Iterator[tuple[str, bytes]]:
    """Give topic and text of each message, in the order of the file, without holding the file.

    A name that ends in a slash means every topic below it; messages stamped before `from_ns`
    are left out. Raises RecordingError where the file is no MCAP.
    """
    for block, names in _wanted_blocks(path, topics, from_ns):
        for message in block.cut_out():
            if message.channel_id in names and message.log_time >= from_ns:
                yield names[message.channel_id], message.data


def _wanted_blocks(
    path: Path, topics: Iterable[str], from_ns: float = 0.0
) -> Iterator[tuple[Messages, Mapping[int, str]]]:
    """Give messages in blocks, with the wanted ones' topics by channel, as known so far."""
    wanted = set(topics)
    folders = tuple(name for name in wanted if name.endswith("/"))
    names: dict[int, str] = {}
    for block in _read_blocks(path, from_ns):
        if isinstance(block, Messages):
            yield block, names
        elif isinstance(block, Channel) and (
            block.topic in wanted or block.topic.startswith(folders)
        ):
            names[block.id] = block.topic


def read_topics(
    path: Path,
    topics: Iterable[str],
    names: Mapping[str, Sequence[str]] | None = None,
    most: Mapping[str, int] | None = None,
) -> dict[str, dict[str, Rows]]:
    """Return `{topic: {signal: values (n,)}}`, null as not-a-number, and its sample not valid.

    A name that ends in a slash means every topic below it. `names` gives the signals to keep
    of a topic, those that it has; of other topics all are kept. A topic with more rows than `most`
    says, by the same names as `topics`, is thinned to one row in 2, 4, 8, ..., its last included,
    so that a recording of any length fits into memory. A recording that was cut off, even to
    nothing, is read up to its last whole chunk. A topic that the file does not hold is absent from
    the answer. Raises RecordingError where the file is no MCAP, or does not fit into memory.
    """
    found: dict[str, TopicColumns] = {}
    counts = count_messages(path)
    may_take = most_bytes()
    for block, channels in _wanted_blocks(path, topics):
        for channel, places in block.places.items():
            if (topic := channels.get(channel)) is None:
                continue
            if topic not in found:
                wanted, limit = (names or {}).get(topic), _limit(topic, most or {})
                found[topic] = TopicColumns(wanted, limit, counts.get(topic, 0), may_take)
            try:
                found[topic].take(block.data, places)
            except (ValueError, KeyError, TypeError, IndexError, OverflowError):
                _say_damaged(path, int(places[0, 0]), path.stat().st_size)
                return {topic: _judged(columns.whole()) for topic, columns in found.items()}
        refuse_more(path, sum(columns.size_bytes for columns in found.values()), may_take)
    return {topic: _judged(columns.whole()) for topic, columns in found.items()}


def _judged(columns: dict[str, Rows]) -> dict[str, Rows]:
    """Return the columns; where position or force is no number, the sample is missing."""
    if "valid" in columns:
        for name in ("position", "force"):
            if name in columns:
                columns["valid"][~np.isfinite(columns[name])] = 0.0
    return columns


def _limit(topic: str, most: Mapping[str, int]) -> int | None:
    for name, limit in most.items():
        if topic == name or (name.endswith("/") and topic.startswith(name)):
            return limit
    return None
