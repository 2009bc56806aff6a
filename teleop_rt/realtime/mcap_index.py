"""The index at the end of a recording, read without the recording itself."""

from __future__ import annotations

import contextlib
from pathlib import Path

from mcap.reader import make_reader
from mcap.records import Channel
from mcap.summary import Summary

from teleop_rt.realtime.mcap_records import CUT_OFF
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


def declared_channels(path: Path) -> list[Channel]:
    """Return the channels of a file; none where it was cut off."""
    summary = _index_of(path)
    return [] if summary is None else list(summary.channels.values())


def _index_of(path: Path) -> Summary | None:
    with contextlib.suppress(OSError, *CUT_OFF), path.open("rb") as stream:
        return make_reader(stream).get_summary()
    return None
