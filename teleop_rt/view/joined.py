"""One run of a slave and a master that ran on two machines, each with a recording of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from teleop_rt.errors import RecordingError
from teleop_rt.realtime.reading import read_topics
from teleop_rt.trial.folder import LOG, RECORDING, plain_json
from teleop_rt.trial.summary_file import read_summary
from teleop_rt.view.delay import one_way_delays
from teleop_rt.view.run_folder import (
    MASTER_SIGNALS,
    MOST_ROWS,
    Columns,
    Run,
    read_events,
    read_every_tick,
    read_recorded,
    read_trial,
)

_MASTER = "/master"
_LEAST_MODELS = 3  # fewer that both recorded may agree by chance
_MOST_SPREAD_MS = 30.0
"""Spread of the delays of one run (10 % to 90 %): 3 ms with a jitter of 1.5 ms; of two runs of one
trial it was 41 and 73 ms."""
_REASON = "slave and master recorded alone: the felt force is compared with the true one by `run`"
_ALIGNED = (
    "slave and master recorded on two clocks, aligned here by {models} models that both recorded"
    " and half of the round trip of {trip_ms:.4g} ms: a time between both sides is uncertain by"
    " half of the difference between the two ways of the link"
)
_OF_SLAVE = ("safety", "missed_ticks", "late", "recorder")
Rebuild = Callable[[Path, Columns, Mapping[str, Any] | None], Mapping[str, Any]]
"""As in `view.commands`."""


def sides_of(folders: Sequence[Path]) -> tuple[Path, Path]:
    """Return the folders of slave and master, in this order.

    Raises RecordingError where these are not one of each.
    """
    sides = {(read_summary(folder) or {}).get("side"): folder for folder in folders}
    if len(folders) != 2 or set(sides) != {"slave", "master"}:
        raise RecordingError(
            "give one run folder, or two or more after --compare; or the folders that a slave and a"
            " master, each started alone, have written in one run"
        )
    return sides["slave"], sides["master"]


def open_joined(folders: Sequence[Path], rebuild: Rebuild) -> Run:
    """Return the run of both sides, on the slave's clock. Raises RecordingError."""
    of_slave, of_master = sides_of(folders)
    topics = dict(read_recorded(of_slave))
    read = read_topics(of_master / RECORDING, [_MASTER], {_MASTER: MASTER_SIGNALS}, MOST_ROWS)
    counted, counted_there = read_summary(of_slave) or {}, read_summary(of_master) or {}
    trip_ms = counted_there["link"]["round_trip_ms"] or counted["link"]["round_trip_ms"]
    ahead_ns, models = clock_ahead_ns(topics["/slave"], read.get(_MASTER, {}), trip_ms)
    columns = read[_MASTER]
    topics[_MASTER] = {**columns, "stamp_ns": columns["stamp_ns"] - ahead_ns}
    summary = plain_json(rebuild(of_slave, read_every_tick(of_slave), None))
    summary |= {key: counted[key] for key in _OF_SLAVE}
    refused = counted["link"]["rejected"] + counted_there["link"]["rejected"]
    summary["link"] = counted["link"] | {"master": counted_there["link"], "refused": refused}
    summary["master"] |= {"rendering": counted_there["rendering"], "reason": _REASON}
    summary["notes"] = [
        *(f"slave: {note}" for note in counted["notes"]),
        *(f"master: {note}" for note in counted_there["notes"]),
        _ALIGNED.format(models=models, trip_ms=trip_ms),
    ]
    events = read_events(of_slave / LOG)
    for event in read_events(of_master / LOG):
        stamp = {"stamp_ns": event["stamp_ns"] - ahead_ns} if "stamp_ns" in event else {}
        events.append(event | stamp)
    events.sort(key=lambda event: event.get("stamp_ns", 0))
    return Run(of_slave, read_trial(of_slave), summary, topics, events)


def clock_ahead_ns(slave: Columns, master: Columns, trip_ms: float | None) -> tuple[float, int]:
    """Return by how much the master's clock is ahead of the slave's, and from how many models.

    Both recorded the number of the newest model; its way takes half of the round trip. Raises
    RecordingError where no model shows it, or these are of two runs.
    """
    delays = one_way_delays(slave, master)
    known = np.empty(0) if delays is None else delays.delay_ms[np.isfinite(delays.delay_ms)]
    if trip_ms is None or known.size < _LEAST_MODELS:
        raise RecordingError(
            "slave and master recorded on two clocks, and fewer than three models reached the"
            " master, which could align them: `teleop-rt live FOLDER` shows each recording"
        )
    low, high = np.quantile(known, (0.1, 0.9))
    if high - low > _MOST_SPREAD_MS:
        raise RecordingError(
            "these folders seem to be of two runs: the delays of their models differ by"
            f" {high - low:.0f} ms, more than {_MOST_SPREAD_MS:g}: give the folders of one run"
        )
    return float(np.median(known) - 0.5 * trip_ms) * 1e6, int(known.size)
