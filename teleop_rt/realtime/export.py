"""Make an unfinished recording whole, and write recordings as tables that others read."""

from __future__ import annotations

import csv
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import scipy
import yaml
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer
from numpy.typing import NDArray

from teleop_rt.errors import RecordingError
from teleop_rt.extras import install_command
from teleop_rt.outputs import refuse_existing
from teleop_rt.realtime.columns import Rows
from teleop_rt.realtime.mcap_chunk import Unreadable
from teleop_rt.realtime.mcap_index import count_messages
from teleop_rt.realtime.mcap_records import Record
from teleop_rt.realtime.parts import parts
from teleop_rt.realtime.reading import read_metadata, read_records, read_topics
from teleop_rt.realtime.recording import ONLINE

FORMATS = (".csv", ".npz", ".mat", ".parquet")
_UNIT = re.compile(r"\[([^\]]*)\]")
_NO_UNIT = ("1", "count")
_ROLES = {
    "/slave": {
        "time": "sample_stamp_ns",
        "position": "position",
        "force": "force",
        "surface": "surface",
        "valid": "valid",
    },
    "/master": {"time": "stamp_ns", "position": "position", "force": "rendered_force"},
}
"""Which signal plays which role where a table is replayed or diagnosed, by topic."""


def recover(damaged: Path, whole: Path, unreadable: list[Unreadable] | None = None) -> int:
    """Copy the readable messages of all parts into one finished file; return their number.

    Damaged chunks are left out, and appended to `unreadable`. Raises RecordingError where the file
    is no MCAP, no message of it can be read, or `whole` exists already.
    """
    refuse_existing([whole], "name another file with --out")
    if not any(isinstance(record, Message) for record in read_records(damaged)):
        size = sum(one.stat().st_size for one in parts(damaged) or [damaged])
        raise RecordingError(
            f"{damaged}: nothing can be recovered: no message can be read in its {size} bytes:"
            " use a copy if there is one"
        )
    with _written(whole), whole.open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.ZSTD)
        writer.start(library="teleop-rt recover")
        copy = _Copy(writer)
        for record in read_records(damaged):
            copy.take(record)
            if isinstance(record, Unreadable) and unreadable is not None:
                unreadable.append(record)
        writer.finish()
    return copy.messages


class _Copy:
    """Records of several parts, written into one file: a topic keeps one channel."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._schemas: dict[int, int] = {}
        self._channels: dict[int, int] = {}
        self._by_topic: dict[str, int] = {}
        self._described: list[Metadata] = []
        self.messages = 0

    def take(self, record: Record) -> None:
        """Write a record, unless it stands in the file already."""
        if isinstance(record, Schema) and record.id not in self._schemas:
            self._schemas[record.id] = self._writer.register_schema(
                record.name, record.encoding, record.data
            )
        elif isinstance(record, Channel) and record.id not in self._channels:
            self._channels[record.id] = self._channel(record)
        elif isinstance(record, Metadata) and record not in self._described:
            self._described.append(record)
            self._writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Message) and record.channel_id in self._channels:
            self.messages += 1
            self._writer.add_message(
                self._channels[record.channel_id],
                record.log_time,
                record.data,
                record.publish_time,
                record.sequence,
            )

    def _channel(self, record: Channel) -> int:
        if record.topic not in self._by_topic:
            self._by_topic[record.topic] = self._writer.register_channel(
                record.topic,
                record.message_encoding,
                self._schemas.get(record.schema_id, 0),
                record.metadata,
            )
        return self._by_topic[record.topic]


def export(recording: Path, table: Path, topic: str) -> int:
    """Write one topic as CSV, NPZ, MAT or Parquet, by the suffix of `table`; return its rows.

    Columns are named with their units, as `replay` and `diagnose` read them; `t_s` counts from the
    first row. Whole numbers are written as such, null as not-a-number. The force is as measured;
    NAME.columns.yaml beside the table contains its known lag, the missing samples, and the meaning
    of the columns. Raises RecordingError for an unknown suffix or topic, OutputError where a
    file exists.
    """
    refuse_existing([table])
    suffix = table.suffix.lower()
    if suffix not in FORMATS:
        raise RecordingError(f"{table}: unknown kind of file; one of: {', '.join(FORMATS)}")
    columns = read_topics(recording, [topic]).get(topic)
    if columns is None:
        known = sorted({r.topic for r in read_records(recording) if isinstance(r, Channel)})
        raise RecordingError(f"{recording}: no topic {topic}; it has: {', '.join(known)}")
    if suffix == ".parquet":
        parquet_writer()  # refused before anything is written
    units = units_of(recording, topic)
    layout = _layout(recording, topic, columns, units)
    beside = table.with_name(f"{table.stem}.columns.yaml")
    described = layout and beside.is_file() and beside.read_text(encoding="utf-8") == layout
    if layout and not described:
        refuse_existing([beside])
    with _written(table):
        _write_table(table, _with_units(columns, units))
        if layout and not described:
            beside.write_text(layout, encoding="utf-8")
    return next(iter(columns.values())).size


def _layout(
    recording: Path,
    topic: str,
    columns: Mapping[str, Rows],
    units: Mapping[str, tuple[str, bool]],
) -> str:
    """Return the text of NAME.columns.yaml for a table, empty if it cannot be replayed."""
    named = {
        role: _named(name, units.get(name, ("", False))[0])
        for role, name in _ROLES.get(topic, {}).items()
        if name in columns
    }
    if not {"position", "force"} <= set(named):
        return ""
    valid = named.pop("valid", None)
    layout: dict[str, Any] = {"columns": named}
    if valid is not None:
        online = read_metadata(recording, ONLINE)
        settings = {} if online is None else json.loads(online["settings"])
        lag_s = settings.get("paired_lag_s") or settings.get("force_lag_s", 0.0)
        layout |= {"valid": valid, "force_lag_ms": 1e3 * lag_s}
        if (deviation_s := settings.get("force_lag_deviation_s", 0.0)) > 0.0:
            layout["force_lag_deviation_ms"] = 1e3 * deviation_s
        known = columns.get("surface_deviation", np.empty(0))
        known = known[np.isfinite(known) & (known >= 0.0)]  # a damaged row holds any number
        if known.size:
            layout["surface_deviation"] = float(known[-1])
    return yaml.safe_dump(layout, sort_keys=False)


def is_whole(recording: Path) -> int | None:
    """Return the number of messages of a recording that lacks nothing, None where it does.

    Every part must be finished, and contain as many messages as its index states.
    """
    described = stated_messages(recording)
    if described is None:
        return None
    found = sum(isinstance(record, Message) for record in read_records(recording))
    return found if found == described else None


def stated_messages(recording: Path) -> int | None:
    """Return the number of messages by the indices of all parts; None where one is cut off."""
    described = 0
    for one in parts(recording) or [recording]:
        with one.open("rb") as stream:
            if not _finished(stream):
                return None
        described += sum(count_messages(one).values())
    return described


def span_s(recording: Path) -> float:
    """Return the time from the earliest message of a recording to the latest [s]; 0 without any."""
    stamps = [one.log_time for one in read_records(recording) if isinstance(one, Message)]
    return 1e-9 * (max(stamps) - min(stamps)) if stamps else 0.0


def _finished(stream: BinaryIO) -> bool:
    """Return whether a file ends as MCAP says that a finished one does."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - len(MCAP0_MAGIC)))
    return stream.read() == MCAP0_MAGIC


def units_of(recording: Path, topic: str) -> dict[str, tuple[str, bool]]:
    """Return unit and whether it is a whole number, of each signal of a topic, as its schema says.

    Nothing of a recording of another program, whose schema says neither.
    """
    schemas = {}
    for record in read_records(recording):
        if isinstance(record, Schema):
            schemas[record.id] = record.data
        elif isinstance(record, Channel) and record.topic == topic:
            return _described_by(schemas.get(record.schema_id, b""))
    return {}


def _described_by(schema: bytes) -> dict[str, tuple[str, bool]]:
    try:
        properties = json.loads(schema)["properties"]
        return {
            name: (found[1], "integer" in one["type"])
            for name, one in properties.items()
            if (found := _UNIT.match(one["description"])) is not None
        }
    except (ValueError, KeyError, TypeError, AttributeError):
        return {}


def _with_units(
    columns: Mapping[str, Rows], described: Mapping[str, tuple[str, bool]]
) -> dict[str, NDArray[np.generic]]:
    """Return the columns under names that end in their units; whole numbers are integers."""
    named: dict[str, NDArray[np.generic]] = {}
    if (stamps := columns.get("stamp_ns")) is not None and stamps.size:
        named["t_s"] = (stamps - stamps[0]) * 1e-9
    for name, values in columns.items():
        unit, whole = described.get(name, ("", False))
        exact = whole and bool(np.all(np.isfinite(values)))
        named[_named(name, unit)] = values.astype(np.int64) if exact else values
    return named


def _named(name: str, unit: str) -> str:
    """Return a column's name with its unit, in letters that every program takes for a name."""
    suffix = unit.replace("/", "_per_").replace(" ", "_").replace("^", "")
    suffix = re.sub(r"[^A-Za-z0-9_]", "", suffix)
    if not suffix or unit in _NO_UNIT or name.endswith(f"_{suffix}"):
        return name
    return f"{name}_{suffix}"


def _write_table(table: Path, columns: Mapping[str, NDArray[np.generic]]) -> None:
    if table.suffix.lower() == ".csv":
        with table.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.writer(stream)
            writer.writerow(columns)
            writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    elif table.suffix.lower() == ".parquet":
        parquet_writer()(table, columns)
    elif table.suffix.lower() == ".npz":
        np.savez_compressed(table, **columns)  # type: ignore[arg-type]  # a mapping of arrays
    else:
        scipy.io.savemat(table, dict(columns), do_compression=True, long_field_names=True)


def parquet_writer() -> Callable[[Path, Mapping[str, NDArray[np.generic]]], None]:
    """Return a writer of columns (n,) or (n, m) as Parquet. Raises RecordingError."""
    try:
        import pyarrow as pa  # noqa: PLC0415 - an extra
        from pyarrow import parquet  # noqa: PLC0415 - as above
    except ImportError:
        raise RecordingError(f"Parquet needs pyarrow: `{install_command('parquet')}`") from None

    def column(values: NDArray[np.generic]) -> Any:
        if values.ndim == 1:
            return pa.array(values)
        flat = pa.array(values.reshape(-1))
        return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])

    def write(file: Path, columns: Mapping[str, NDArray[np.generic]]) -> None:
        table = pa.table({name: column(values) for name, values in columns.items()})
        parquet.write_table(table, file)

    return write


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """Raise RecordingError with the cause if a new file cannot be written; no part of it stays."""
    try:
        yield
    except OSError as error:
        with suppress(OSError):
            path.unlink()
        raise RecordingError(
            f"{path}: cannot be written: {error.strerror}: name a file in a folder that is there"
            " and has room"
        ) from None
