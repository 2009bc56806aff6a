"""Make an unfinished recording whole, and write recordings as tables that others read."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import scipy
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from teleop_rt.errors import RecordingError
from teleop_rt.realtime.columns import Rows
from teleop_rt.realtime.recording import read_records, read_topics

FORMATS = (".csv", ".npz", ".mat")


def recover(damaged: Path, whole: Path) -> int:
    """Copy what can be read of all parts into one finished file; return the messages saved.

    Raises RecordingError where the file is no MCAP or `whole` exists already.
    """
    if whole.exists():
        raise RecordingError(f"{whole}: exists already: name another file with --out")
    next(read_records(damaged), None)  # what is no recording is refused before a file is made
    messages = 0
    with _written(whole), whole.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(library="teleop-rt recover")
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        by_topic: dict[str, int] = {}
        told: list[Metadata] = []
        for record in read_records(damaged):
            if isinstance(record, Schema) and record.id not in schemas:
                schemas[record.id] = writer.register_schema(
                    record.name, record.encoding, record.data
                )
            elif isinstance(record, Channel) and record.id not in channels:
                if record.topic not in by_topic:
                    by_topic[record.topic] = writer.register_channel(
                        record.topic,
                        record.message_encoding,
                        schemas.get(record.schema_id, 0),
                        record.metadata,
                    )
                channels[record.id] = by_topic[record.topic]
            elif isinstance(record, Metadata) and record not in told:
                told.append(record)
                writer.add_metadata(record.name, record.metadata)
            elif isinstance(record, Message) and record.channel_id in channels:
                messages += 1
                writer.add_message(
                    channels[record.channel_id],
                    record.log_time,
                    record.data,
                    record.publish_time,
                    record.sequence,
                )
        writer.finish()  # type: ignore[no-untyped-call]  # mcap is half typed
    return messages


def export(recording: Path, table: Path, topic: str) -> int:
    """Write one topic as CSV, NPZ or MAT, by the suffix of `table`; return the rows written.

    Not-a-number stands for null. Raises RecordingError for an unknown suffix or topic.
    """
    suffix = table.suffix.lower()
    if suffix not in FORMATS:
        raise RecordingError(f"{table}: unknown kind of file; one of: {', '.join(FORMATS)}")
    columns = read_topics(recording, [topic]).get(topic)
    if columns is None:
        known = sorted({r.topic for r in read_records(recording) if isinstance(r, Channel)})
        raise RecordingError(f"{recording}: no topic {topic}; it has: {', '.join(known)}")
    with _written(table):
        _write_table(table, columns)
    return next(iter(columns.values())).size


def _write_table(table: Path, columns: Mapping[str, Rows]) -> None:
    if table.suffix.lower() == ".csv":
        with table.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    elif table.suffix.lower() == ".npz":
        np.savez_compressed(table, **columns)  # type: ignore[arg-type]  # a mapping of arrays
    else:
        scipy.io.savemat(table, dict(columns), do_compression=True)


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """Tell why a file cannot be written."""
    try:
        yield
    except OSError as error:
        raise RecordingError(
            f"{path}: cannot be written: {error.strerror}: name a file in a folder that is there"
            " and has room"
        ) from None
