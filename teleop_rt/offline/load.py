"""Load a recording from any file that replay and diagnosis read: our MCAP, or a foreign table."""

from __future__ import annotations

import functools
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.fitted import ExtendedModelError
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.extension import Extension, extension_from
from teleop_rt.estimation.pipeline import PipelineSettings
from teleop_rt.estimation.recorded import Samples, estimated_samples
from teleop_rt.estimation.rows import FROZEN_LABEL, RowSpec, rows_for
from teleop_rt.offline.table import Table
from teleop_rt.realtime.mcap_end import ends_whole
from teleop_rt.realtime.reading import read_metadata, read_topics
from teleop_rt.realtime.recording import ONLINE
from teleop_rt.recordings.layout import layout_of
from teleop_rt.recordings.recording import (
    Recording,
    from_columns,
    last_known,
    load,
    without_lag,
)

Array = NDArray[np.float64]

_ESTIMATED = ("sample_stamp_ns", "valid", "position", "force")
"""Signals that the samples of the estimators are made of: of an hour all would not fit in memory,
and the rest of a row is not read."""
_PAIRED = ("stamp_ns", "position_age_ms", "force_age_ms")
"""Signals that are needed beside them where the samples are pairs of a slow sensor's."""
_NO_SLAVE = "{}: has no slave's side of a run: give the recording of a run"


@dataclass(frozen=True, slots=True)
class Online:
    """The on-line estimation of a run: settings, rows and samples, also missing ones."""

    settings: PipelineSettings
    rows: list[RowSpec]
    position: Array
    force: Array
    valid: NDArray[np.bool_]
    units: tuple[str, str]


def load_online(path: Path, effects: Path | None = None) -> Online:
    """Return the estimators that ran on-line in one of our recordings. Raises RecordingError.

    `effects` is a Python file with effects of the user's. The one that a recording names is a
    program, and is not run.
    """
    metadata = _metadata(path)
    rows: list[RowSpec] = []
    labels = [(m, r, s.removesuffix(FROZEN_LABEL)) for m, r, s in json.loads(metadata["rows"])]
    for model, regression, solver in dict.fromkeys(labels):
        rows += rows_for([model], [regression], [solver])
    settings = _settings(path, metadata)
    extended = json.loads(metadata.get("extended_model", "null"))
    if extended is not None:
        extension = _extension(path, extended, metadata["effects_file"], effects)
        rows, settings = extension.rows(rows), extension.settings(settings)
    samples = _samples(_recorded(path, settings), settings)
    return Online(
        settings=settings,
        rows=rows,
        position=samples.position,
        force=samples.force,
        valid=samples.valid,
        units=(metadata["position_unit"], metadata["force_unit"]),
    )


def _metadata(path: Path) -> dict[str, str]:
    """Return a recording's metadata of the run. Raises RecordingError."""
    metadata = read_metadata(path, ONLINE)
    _note_cut_off(path)
    if metadata is None:
        raise RecordingError(_NO_SLAVE.format(path))
    return metadata


def _recorded(path: Path, settings: PipelineSettings, *more: str) -> dict[str, Array]:
    """Return the signals of a slave that samples are made of, and `more`. Raises RecordingError."""
    signals = (*_ESTIMATED, *(() if settings.paired_lag_s is None else _PAIRED), *more)
    slave = read_topics(path, ["/slave"], {"/slave": signals}).get("/slave")
    if slave is None:
        raise RecordingError(_NO_SLAVE.format(path))
    return slave


@functools.cache
def _note_cut_off(path: Path) -> None:
    """Print once that a recording ends without its end, as after a crash or a partial copy."""
    with path.open("rb") as stream:
        whole = ends_whole(stream)
    if not whole:
        print(
            f"{path}: cut off: it is read up to its last whole part, so the end of the run is"
            " missing",
            file=sys.stderr,
        )


def _settings(path: Path, metadata: dict[str, str]) -> PipelineSettings:
    try:
        return PipelineSettings(**json.loads(metadata["settings"]))
    except (TypeError, ValueError, KeyError) as error:
        raise RecordingError(
            f"{path}: its settings are not those of this version: {error}:"
            " replay it with the version that recorded it"
        ) from error


def _samples(slave: dict[str, Array], settings: PipelineSettings) -> Samples:
    loop_period_ns = round(settings.period_s * 1e9)
    if settings.paired_lag_s is not None:
        loop_period_ns = round(float(np.median(np.diff(slave["stamp_ns"]))))
    return estimated_samples(slave, settings, loop_period_ns)


def _extension(path: Path, extended: Any, named: str, effects: Path | None) -> Extension:
    """Return the extension that ran. Raises RecordingError where it needs a program to be run."""
    try:
        return extension_from(str(path), extended, None if effects is None else str(effects))
    except ExtendedModelError as error:
        if effects is None and named:
            raise RecordingError(
                f"{path}: ran with effects of {named}: read that program, then run"
                " `teleop-rt replay --effects FILE`"
            ) from error
        raise


def load_any(path: Path, table: Table) -> Recording:
    """Return the recording in an MCAP, CSV, MAT or NPZ file. Raises RecordingError.

    In our own recordings the force's known lag, as calibrated on the rig, is taken out.
    """
    if path.suffix.lower() != ".mcap":
        layout = layout_of(path, table.columns, table.units, table.rate_hz)
        return load(path, layout)
    if table.rate_hz is not None:
        raise RecordingError(f"{path}: has times of its own: leave out --rate")
    metadata = _metadata(path)
    settings = _settings(path, metadata)
    slave = _recorded(path, settings, "surface")
    surface = last_known(slave["surface"])
    if settings.paired_lag_s is not None:
        position, force, fresh, stamps = _samples(slave, settings)
    else:
        stamps, position, force = (
            slave.pop(name) for name in ("sample_stamp_ns", "position", "force")
        )
        fresh = (slave["valid"] > 0) & (np.diff(stamps, prepend=-1.0) > 0)
    del slave  # of an hour the columns fill more memory than the rest
    columns = {"time": stamps[fresh], "position": position[fresh], "force": force[fresh]}
    del stamps, position, force, fresh
    columns["time"] = (columns["time"] - columns["time"][0]) * 1e-9
    columns["force"] = without_lag(columns["time"], columns["force"], settings.force_lag_s)
    made = from_columns(
        path.name,
        columns,
        units=(metadata["position_unit"], metadata["force_unit"]),
        surface=surface,
    )
    return replace(made, run=str(path))
