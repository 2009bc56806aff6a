"""Run the estimators over a recording, by the very kernels that run on-line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from teleop_rt.contact.models import MODELS
from teleop_rt.diagnosis.samples.exchanged import exchange_note, stands_beside_refusals
from teleop_rt.diagnosis.samples.implausible import doubtful_unit, refuse_wrong_units
from teleop_rt.diagnosis.samples.surface import refuse_turned
from teleop_rt.errors import RecordingError
from teleop_rt.estimation.parameters import leading, traced_names
from teleop_rt.estimation.pipeline import Pipeline, PipelineSettings
from teleop_rt.estimation.report import KEYS, report_with_delays, worth_selecting
from teleop_rt.estimation.rows import RowSpec, rows_for
from teleop_rt.estimation.trace import Trace
from teleop_rt.ids import REGRESSIONS, SOLVERS
from teleop_rt.offline.load import Online, load_any, load_online
from teleop_rt.offline.no_contact import ONSET_NOISES, no_contact
from teleop_rt.offline.table import Table
from teleop_rt.outputs import refuse_existing
from teleop_rt.realtime.scheduling import give_back_compiler
from teleop_rt.recordings.recording import Recording
from teleop_rt.recordings.rows import force_noise, quantisation_step, stretches

RELEASE_NOISES = 4.0
"""Force that is no contact any more, in deviations of the force's noise."""
_SMALLEST_SHARE = 1e-3
"""Noise assumed at least, of the range of the force: a simulated force may have none."""
_FINEST_SHARE = 2.0**-16
"""Resolution of positions without a grid, over their travel: that of a 16-bit converter.

The surface is compared between contacts in units of it; with the resolution of a double every
contact would count as one with another body, and the estimate would start again.
"""
_CUTOFF_HZ, _CUTOFF_SHARE = 60.0, 0.3
"""Cutoff of the differentiator, and the largest one over the rate, which must be below a third. At
100 samples/s a share of 0.1 finds twice the error of the damping."""
MOST_KEPT = 4_000_000
"""Parameter sets of all rows in a trace: of more, one in so many samples is kept."""


@dataclass(frozen=True, slots=True)
class Choice:
    """Which estimators to replay, None for all (or those of the run), and where the surface is."""

    models: Sequence[str] | None = None
    regressions: Sequence[str] | None = None
    solvers: Sequence[str] | None = None
    surface: float | None = None

    @property
    def own(self) -> bool:
        """Whether anything was chosen that a run's own replay would not have."""
        return self == Choice()

    def rows(self) -> list[RowSpec]:
        """Return the chosen rows. Raises ValueError for an unknown name."""
        models = self.models or [name for name in MODELS if name != "mass-damper"]
        return rows_for(models, self.regressions or REGRESSIONS, self.solvers or SOLVERS)


def replay(
    path: Path,
    choice: Choice,
    table: Table,
    effects: Path | None = None,
    *,
    traces: bool = True,
) -> tuple[dict[str, Any], Trace]:
    """Return the answer for one recording, JSON-ready, and parameters over time.

    Unless it `traces` all, only those are kept over time that the answer needs.
    A run's own recording is replayed as it ran unless something else is chosen; `effects` is a
    Python file with the user's effects, if it ran with some. Raises RecordingError where the file
    cannot be used, ValueError for an unknown name.
    """
    online = online_of(path, choice, table, effects)
    rows, selected, trace, doubt = run_estimators(online, traces=traces)
    keys = (*KEYS, "parameters")
    answer = {
        "recording": str(path),
        "samples": int(online.position.size),
        "gaps": _gaps(online.valid),
        "estimators": rows,
        "selected": {key: rows[selected][key] for key in keys} if selected >= 0 else None,
        "notes": [note for note in (doubt, _doubtful_unit(rows, online)) if note],
    }
    return answer, trace


def _gaps(valid: NDArray[np.bool_]) -> dict[str, int]:
    """Return how many samples are missing between the first and the last, and in how many gaps."""
    known = np.flatnonzero(valid)
    gaps = stretches(~valid[known[0] : known[-1]]) if known.size else []
    return {"count": len(gaps), "samples": sum(past - first for first, past in gaps)}


def _doubtful_unit(rows: Sequence[dict[str, Any]], online: Online) -> str | None:
    """Return a note where the stiffness of the best linear model asks for another unit."""
    errors = [(row["nrmse"], row["parameters"]["k"]["value"]) for row in rows
              if row["model"] == "kelvin-voigt" and row["nrmse"] is not None]  # fmt: skip
    if not errors:
        return None
    known = online.valid  # a copy of an hour's valid positions would be as large as all
    deepest = float(np.max(online.position, initial=-np.inf, where=known))
    travel = deepest - float(np.min(online.position, initial=np.inf, where=known))
    return doubtful_unit(online.units[0], travel, min(errors)[1])


REJECTED = (
    "the residual of the best model is not white: something is missing in it, so the parameters may"
    " be wrong and have no deviations; `teleop-rt diagnose` names the missing effect"
)


def run_estimators(
    online: Online, *, traces: bool = True
) -> tuple[list[dict[str, Any]], int, Trace, str]:
    """Return the rows as in the summary, the one that is selected (-1: none), trace and doubt.

    The doubt is a sentence where no contact begins that a row needs, or where the residual rejects
    the best model, else empty. No row has deviations if it does: they are those of a white one.
    """
    pipeline = Pipeline(online.rows, online.settings)
    every = 1 + len(online.position) * len(online.rows) // MOST_KEPT
    names_of = traced_names if traces else lambda row: [leading(row)]
    trace = pipeline.run(online.position, online.force, online.valid, every, names_of)
    give_back_compiler()  # all kernels are loaded: an hour's report has that much more room
    rows = report_with_delays(pipeline, trace, *online.units)
    selected = pipeline.selected
    if selected >= 0 and not worth_selecting(rows[selected]):
        selected = -1
    if not (pipeline.inadequate or pipeline.residual_has_memory):
        return rows, selected, trace, no_contact(online) if _misses_contact(pipeline) else ""
    for row in rows:
        for parameter in row["parameters"].values():
            parameter["std"] = None
    return rows, selected, trace, REJECTED


def _misses_contact(pipeline: Pipeline) -> bool:
    """Return whether there was no contact, and a row that estimates nothing but in contact."""
    if pipeline.settings.surface is not None or pipeline.contact.contact_id > 0:
        return False
    return any(row.declared.in_contact_only for row in pipeline.rows)


def online_of(path: Path, choice: Choice, table: Table, effects: Path | None = None) -> Online:
    """Return samples, settings and rows for a recording, as it ran unless something is chosen."""
    if path.suffix.lower() != ".mcap":
        return online_of_recording(load_any(path, table), choice)
    online = load_online(path, effects)
    if choice.own:
        return online
    return replace(
        online, rows=choice.rows(), settings=replace(online.settings, surface=choice.surface)
    )


def _refuse_beyond(recording: Recording, surface: float | None) -> None:
    """Raise RecordingError where no position reaches the surface that the user states."""
    lowest, deepest = float(np.min(recording.position)), float(np.max(recording.position))
    if surface is not None and surface >= deepest:
        unit, _ = recording.units
        raise RecordingError(
            f"{recording.name}: no contact: positions lie between {lowest:.4g} and {deepest:.4g}"
            f" {unit}, none beyond the surface at {surface:.4g} {unit}; correct it:"
            f" --surface takes {unit}, or a unit as in 10mm"
        )


def online_of_recording(recording: Recording, choice: Choice) -> Online:
    """Return a recording without settings, with settings derived from its noise.

    Raises RecordingError where its figures hint at a wrong unit or sign.
    """
    with stands_beside_refusals(exchange_note(recording)):
        refuse_wrong_units(recording, None)
        _refuse_beyond(recording, choice.surface)
        if choice.surface is None and recording.surface is None:
            refuse_turned(recording)
    noise = max(force_noise(recording.force), _SMALLEST_SHARE * float(np.ptp(recording.force)))
    settings = PipelineSettings(
        period_s=recording.dt,
        position_resolution=max(
            quantisation_step(recording.position),
            _FINEST_SHARE * float(np.ptp(recording.position)),
        ),
        force_noise=noise,
        onset_force=ONSET_NOISES * noise,
        release_force=RELEASE_NOISES * noise,
        cutoff_hz=min(_CUTOFF_HZ, _CUTOFF_SHARE / recording.dt),
        surface=choice.surface if choice.surface is not None else recording.surface,
        surface_deviation=recording.surface_deviation if choice.surface is None else 0.0,
        force_lag_deviation_s=recording.force_lag_deviation_s,
    )
    return Online(
        settings=settings,
        rows=choice.rows(),
        position=recording.position,
        force=recording.force,
        valid=recording.mask > 0,
        units=recording.units,
    )


def write_trace(path: Path, trace: Trace) -> None:
    """Write parameters over time as NPZ: `t_s` and one array (samples,) per row and parameter.

    Raises RecordingError where the file exists.
    """
    refuse_existing([path])
    columns: dict[str, Any] = {"t_s": np.arange(len(trace.signals)) * trace.period_s}
    for index, row in enumerate(trace.rows):
        for name in trace.names(index):
            key = f"{row.model}/{row.regression}/{row.solver}/{name}"
            columns[key] = trace.physical(index, name)
    try:
        np.savez_compressed(path, **columns)
    except OSError:
        path.unlink(missing_ok=True)
        raise
