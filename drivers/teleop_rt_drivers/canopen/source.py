"""Records that kernels share of a cycle's frames: sources of values, and the reading of a cycle.

A source is one value, or the drive, with all that is known of it: a record whose fields kernels
read and write by name.
"""

from __future__ import annotations

import math
from typing import cast

import numpy as np
from numpy.typing import NDArray

from teleop_rt.kernels.record import record_type

NOWHERE, NOBODY = -1, -1  # a field that a frame lacks, and a COB-ID that no node has


class SourceFields:
    """Fields of a source: places in its frame (NOWHERE: not there), its checks, its state."""

    cob_id: int
    length: int
    is_drive: int
    number_at: int
    number_kind: int
    status_at: int
    status_kind: int
    extra_at: int
    extra_kind: int
    most_extra: float
    offset: float
    gain: float
    lower: float
    upper: float
    slack: float
    rate_per_ns: float
    # Answers of the present cycle, and those that are owed, were given up, or are too many.
    received: int
    owed: int
    given_up: int
    behind_cycles: int
    excess_cycles: int
    # A value: its candidate of this cycle, and the one that passed every check [rig unit].
    candidate: float
    value: float
    stamp_ns: int
    known: int
    # A drive: its statusword and the one that was looked at, its own position and force in counts.
    statusword: int
    seen: int
    actual: float
    force_counts: float
    force_gain: float
    silent_cycles: int
    # Whether it is to follow, by the last statusword that was looked at, and its zero is known.
    running: int
    aligned: int
    # Its command: places in the frame, and the target that was sent last [counts].
    target_at: int
    control_at: int
    target: int


SOURCE_TYPE = record_type(SourceFields)
Sources = NDArray[np.record]
_NAMES = list(SourceFields.__annotations__)


def place(field: str) -> int:
    """Return where a field is among the words of a source."""
    return _NAMES.index(field)


class SourceRecord:
    """A source and its views: `stored` for kernels, `source` by field, `floats` and `counts`."""

    def __init__(self) -> None:
        self.bind(np.zeros(1, SOURCE_TYPE))
        source = self.source
        source.cob_id = NOBODY
        source.number_at = source.status_at = source.extra_at = NOWHERE
        source.candidate = math.nan

    def bind(self, stored: Sources) -> None:
        """Live in this array (1,) from now on, which holds the record's values."""
        self.stored = stored
        self.source = cast("SourceFields", stored[0])
        words = stored.view(np.uint8).data
        self.floats, self.counts = words.cast("d"), words.cast("q")


class Reading:
    """Fields of a sample's parts.

    `encoder`, `force_sensor` and `drive` are their places among the sources, or NOWHERE; beside
    them are the home switch, the latched fault, and cycles without a valid sample.
    """

    encoder: int
    force_sensor: int
    drive: int
    closed: int
    fault: int
    missing: int


_READING = record_type(Reading)
Readings = NDArray[np.record]


def new_reading(encoder: int, force_sensor: int, drive: int) -> Readings:
    """Return a reading (1,) of sources at these places."""
    readings: Readings = np.zeros(1, _READING)
    reading = cast("Reading", readings[0])
    reading.encoder, reading.force_sensor, reading.drive = encoder, force_sensor, drive
    return readings


def side_by_side(records: list[SourceRecord]) -> Sources:
    """Return an array in which all these sources live from now on."""
    sources: Sources = np.zeros(len(records), SOURCE_TYPE)
    for index, record in enumerate(records):
        sources[index] = record.stored[0]
        record.bind(sources[index : index + 1])
    return sources
