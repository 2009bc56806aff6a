"""The index at the end of a recording, read without the recording itself."""

from __future__ import annotations

import contextlib
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics
from mcap.summary import Summary

from teleop_rt.realtime.mcap_end import RECORD_HEAD, summary_place
from teleop_rt.realtime.mcap_unpack import CUT_OFF
from teleop_rt.realtime.parts import parts


def count_messages(path: Path) -> dict[str, int]:
    """Return the number of messages of each topic by the indices of a recording.

    A part that was cut off has no index and is not counted.
    """
    counts: dict[str, int] = {}
    for part in parts(path) or [path]:
        summary = _index_of(part)
        if summary is None or summary.statistics is None:
            continue
        for channel, count in summary.statistics.channel_message_counts.items():
            if channel in summary.channels:
                topic = summary.channels[channel].topic
                counts[topic] = counts.get(topic, 0) + count
    return counts


def time_span(path: Path) -> tuple[int, int] | None:
    """Return the first and the last stamp [ns] of a recording; None where it was cut off."""
    starts, ends = [], []
    for part in parts(path) or [path]:
        summary = _index_of(part)
        if summary is None or summary.statistics is None:
            return None
        starts.append(summary.statistics.message_start_time)
        ends.append(summary.statistics.message_end_time)
    return min(starts), max(ends)


def declared_channels(path: Path) -> list[Schema | Channel]:
    """Return the channels of a file, after their schemas; none where it was cut off."""
    summary = _index_of(path)
    return [] if summary is None else [*summary.schemas.values(), *summary.channels.values()]


def _index_of(path: Path) -> Summary | None:
    """Return statistics and channels by the end of a file; None where it was cut off.

    An hour has 26 000 indices of chunks there, which the library would read, 40 us each.
    """
    with contextlib.suppress(OSError, *CUT_OFF), path.open("rb") as stream:
        if place := summary_place(stream):
            stream.seek(place[0])
            return _summary(stream.read(place[1] - place[0]))
    return None


def _summary(section: bytes) -> Summary:
    """Return the statistics, the channels and their schemas among the records of a file's end."""
    summary = Summary()
    at = 0
    while at < len(section):
        opcode, length = RECORD_HEAD.unpack_from(section, at)
        begin = at + RECORD_HEAD.size
        at = begin + length
        if at > len(section):
            raise EOFError
        if opcode in (Opcode.STATISTICS, Opcode.SCHEMA, Opcode.CHANNEL):
            content = ReadDataStream(BytesIO(section[begin:at]))
            if opcode == Opcode.STATISTICS:
                summary.statistics = Statistics.read(content)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(content)
                summary.schemas[schema.id] = schema
            else:
                channel = Channel.read(content)
                summary.channels[channel.id] = channel
    return summary
