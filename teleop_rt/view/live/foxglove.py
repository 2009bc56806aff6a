"""A bridge to Foxglove: the feed of the live page over WebSocket, read-only."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from pathlib import Path

import foxglove

from teleop_rt.errors import RecordingError
from teleop_rt.interrupts import StopRequest
from teleop_rt.view.live.feed import SHOWN_HZ, Columns, Thinner
from teleop_rt.view.live.source import announce, open_source

_POLL_S = 0.04
"""Between two reads of the rings, 25 times a second."""


def bridge_to_foxglove(recording: Path | None, host: str, port: int) -> None:
    """Send every topic as JSON at up to 200 rows a second until interrupted.

    A recording begins to play when somebody subscribes to a topic, so that nobody misses its start.

    Raises RecordingError where nothing runs, the file cannot be played, or the port is in use.
    """
    source, stop = open_source(recording), StopRequest()
    context = foxglove.Context()
    try:
        server = foxglove.start_server(name="teleop-rt", host=host, port=port, context=context)
    except (OSError, RuntimeError) as error:
        raise RecordingError(f"--port {port}: {error}: choose another, or 0 for any") from None
    announce(source.name, f"ws://{host}:{server.port}")
    channels: dict[str, tuple[foxglove.Channel, Thinner]] = {}
    watched = recording is None
    try:
        while not stop():
            if (about := source.about()) is not None:
                step = max(1, round(1.0 / (about.period_s * SHOWN_HZ)))
                for topic, names in source.topics().items():
                    if topic not in channels:
                        channels[topic] = (_channel(topic, names, context), Thinner(step))
                watched = watched or any(channel.has_sinks() for channel, _ in channels.values())
                for topic, rows in source.read().items() if watched else ():
                    channel, thinner = channels[topic]
                    _send(channel, thinner(rows))
            time.sleep(_POLL_S)
    finally:
        server.stop()


def _channel(topic: str, names: list[str], context: foxglove.Context) -> foxglove.Channel:
    properties = {name: {"type": "number"} for name in names}
    return foxglove.Channel(
        topic, schema={"type": "object", "properties": properties}, context=context
    )


def _send(channel: foxglove.Channel, rows: Columns) -> None:
    names = list(rows)
    for values in zip(*(rows[name].tolist() for name in names), strict=True):
        row: Mapping[str, float | None] = {
            name: value if math.isfinite(value) else None
            for name, value in zip(names, values, strict=True)
        }
        channel.log(dict(row), log_time=int(row["stamp_ns"] or 0))
