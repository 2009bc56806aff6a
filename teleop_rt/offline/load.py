"""Load a recording from any file that replay and diagnosis read: our MCAP, or a foreign table."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from teleop_rt.diagnosis.recordings.layout import layout_of
from teleop_rt.diagnosis.recordings.recording import (
    Recording,
    from_arrays,
    last_known,
    load,
    without_lag,
)
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.extension import extension_from
from teleop_rt.estimation.pipeline import PipelineSettings
from teleop_rt.estimation.recorded import estimated_samples
from teleop_rt.estimation.rows import FROZEN_LABEL, RowSpec, rows_for
from teleop_rt.offline.table import Table
from teleop_rt.realtime.recording import ONLINE, read_metadata, read_topics

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Online:
    """The on-line estimation of a run: settings, rows and samples, one per tick, also missing ones.

    `calibrated_lag_s` is the force's lag without what an extended model adds to it.
    """

    settings: PipelineSettings
    rows: list[RowSpec]
    position: Array
    force: Array
    valid: NDArray[np.bool_]
    units: tuple[str, str]
    calibrated_lag_s: float = 0.0
    stamp_ns: Array = field(default_factory=lambda: np.empty(0))


def load_online(path: Path) -> Online:
    """Return what ran on-line in one of our recordings. Raises RecordingError."""
    metadata = read_metadata(path, ONLINE)
    slave = read_topics(path, ["/slave"]).get("/slave")
    if metadata is None or slave is None:
        raise RecordingError(f"{path}: holds no slave of a run of this program")
    rows: list[RowSpec] = []
    labels = [(m, r, s.removesuffix(FROZEN_LABEL)) for m, r, s in json.loads(metadata["rows"])]
    for model, regression, solver in dict.fromkeys(labels):
        rows += rows_for([model], [regression], [solver])
    settings = PipelineSettings(**json.loads(metadata["settings"]))
    lag_s = settings.force_lag_s
    extended = json.loads(metadata.get("extended_model", "null"))
    if extended is not None:
        extension = extension_from(str(path), extended, metadata["effects_file"])
        rows, settings = extension.rows(rows), extension.settings(settings)
    loop_period_ns = round(settings.period_s * 1e9)
    if settings.paired_lag_s is not None:
        loop_period_ns = round(float(np.median(np.diff(slave["stamp_ns"]))))
    samples = estimated_samples(slave, settings, loop_period_ns)
    return Online(
        settings=settings,
        rows=rows,
        position=samples.position,
        force=samples.force,
        valid=samples.valid,
        stamp_ns=samples.stamp_ns,
        units=(metadata["position_unit"], metadata["force_unit"]),
        calibrated_lag_s=lag_s,
    )


def load_any(path: Path, table: Table) -> Recording:
    """Return the recording in an MCAP, CSV, MAT or NPZ file. Raises RecordingError.

    In our own recordings the force's known lag, as calibrated on the rig, is taken out.
    """
    if path.suffix.lower() != ".mcap":
        layout = layout_of(path, table.columns, table.units, table.rate_hz)
        return load(path, layout)
    online = load_online(path)
    slave = read_topics(path, ["/slave"])["/slave"]
    if online.settings.paired_lag_s is not None:
        fresh = online.valid
        stamps, position, force = (
            column[fresh] for column in (online.stamp_ns, online.position, online.force)
        )
    else:
        fresh = (slave["valid"] > 0) & (np.diff(slave["sample_stamp_ns"], prepend=-1.0) > 0)
        stamps = slave["sample_stamp_ns"][fresh]
        position, force = slave["position"][fresh], slave["force"][fresh]
    time_s = (stamps - stamps[0]) * 1e-9
    return from_arrays(
        path.name,
        time_s,
        position,
        without_lag(time_s, force, online.calibrated_lag_s),
        units=online.units,
        surface=last_known(slave["surface"]),
    )
