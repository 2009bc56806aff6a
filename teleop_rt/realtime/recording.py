"""Write recordings: MCAP with one JSON channel per table of signals; `reading` reads them."""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import IO, cast

import numpy as np
from mcap.writer import CompressionType, Writer

from teleop_rt.config.section import Units
from teleop_rt.realtime.columns import Rows
from teleop_rt.realtime.output import PatientFile
from teleop_rt.signals import Signal

ONLINE, RUN = "online-estimation", "run"
"""The metadata records of our recordings: the slave's estimators, and the software."""
BEGAN_AT = "began_at"
"""Key of the second: date, time and zone at which a run on the real clock began (ISO 8601)."""
SIMULATED = "simulated"
"""Key of the second that a run on a simulated rig has, with any value."""
LARGEST_SEQUENCE = 0xFFFFFFFF
"""Largest sequence in MCAP's 32 bits; a row's number is cut to them."""


def _schema(table: Sequence[Signal], units: Units) -> bytes:
    properties = {
        signal.name: {
            "type": ["integer" if signal.integer else "number", "null"],
            "description": f"[{units.fill(signal.unit)}] {signal.meaning}",
        }
        for signal in table
    }
    return json.dumps({"type": "object", "properties": properties}).encode()


class RecordingWriter:
    """An MCAP file; every row of a topic becomes one JSON message, not-a-number becomes null."""

    def __init__(
        self, path: Path, units: Units, metadata: Mapping[str, dict[str, str]] | None = None
    ) -> None:
        """Create the file; `metadata` are named records of text that stand at its beginning."""
        self._stream = PatientFile(path)
        self._writer = Writer(
            cast("IO[bytes]", self._stream),
            chunk_size=1 << 18,
            compression=CompressionType.ZSTD,
            enable_data_crcs=True,
        )
        self._writer.start(library="teleop-rt")
        for name, content in (metadata or {}).items():
            self._writer.add_metadata(name, content)
        self._units = units
        self._channels: dict[str, tuple[int, int, _RowText]] = {}

    def add_topic(self, topic: str, table: Sequence[Signal]) -> None:
        """Declare a topic; its table must hold a signal `stamp_ns`."""
        schema_id = self._writer.register_schema(
            topic.strip("/").replace("/", "."), "jsonschema", _schema(table, self._units)
        )
        channel_id = self._writer.register_channel(topic, "json", schema_id)
        stamp = [signal.name for signal in table].index("stamp_ns")
        self._channels[topic] = (channel_id, stamp, _RowText(table))

    def write_rows(self, topic: str, rows: Rows, numbers: Iterable[int] | None = None) -> None:
        """Append rows (n, columns of the topic's table); `numbers` (n,) count them from 1."""
        channel_id, stamp, text = self._channels[topic]
        counted = (
            itertools.repeat(0) if numbers is None else (n & LARGEST_SEQUENCE for n in numbers)
        )
        known = np.isfinite(rows).tolist()
        for row, finite, number in zip(rows.tolist(), known, counted, strict=False):
            stamp_ns = int(row[stamp])
            self._writer.add_message(channel_id, stamp_ns, text(row, finite), stamp_ns, number)

    @property
    def problem(self) -> str:
        """The disk's last error; empty while it accepts everything."""
        return self._stream.problem

    @property
    def waiting_bytes(self) -> int:
        """How much the disk has not taken yet."""
        return self._stream.waiting_bytes

    @property
    def size_bytes(self) -> int:
        """Length of the file [bytes], with the bytes that wait."""
        return self._stream.tell()

    def flush(self) -> None:
        """Hand everything written so far to the operating system, readable as it stands.

        Bytes that the disk refuses wait for the next call; `problem` gives the cause.
        """
        self._writer.flush()
        self._stream.hand_over()

    def close(self) -> None:
        """Write index and footer, and close the file; `problem` gives the disk's error."""
        self._writer.finish()
        self._stream.close()


class _RowText:
    """Rows of a table as JSON, null for non-finite numbers; one template per pattern of nulls."""

    def __init__(self, table: Sequence[Signal]) -> None:
        self._names = [json.dumps(signal.name).replace("%", "%%") for signal in table]
        self._formats = ["%d" if signal.integer else "%r" for signal in table]
        self._templates: dict[tuple[bool, ...], str] = {}

    def __call__(self, row: Sequence[float], finite: Sequence[bool]) -> bytes:
        """Return a row as JSON; `finite` says which of its numbers are."""
        pattern = tuple(finite)
        template = self._templates.get(pattern)
        if template is None:
            template = self._templates[pattern] = self._template(pattern)
        return (template % tuple(itertools.compress(row, pattern))).encode()

    def _template(self, pattern: Sequence[bool]) -> str:
        fields = zip(self._names, self._formats, pattern, strict=True)
        fields_json = [f"{name}:{form if known else 'null'}" for name, form, known in fields]
        return "{" + ",".join(fields_json) + "}"
